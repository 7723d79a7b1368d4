"""Equation errors: what a model's equations of motion leave when a measured mode is put into them.

Let the model have the modes Phi, eigenvalues lambda_s = omega_s**2 and rows Psi at the sensors. A measured mode r has
lambda_r and a shape u_r = alpha (Psi a_r + n), a_r of length 1. In modal coordinates the equations leave
e_sr = (lambda_r - lambda_s) a_sr / (omega_s omega_r), with omega_r in place of omega_s for rigid modes. A mode that
the model has leaves 0, and so does a mixture of two close ones: no mode is paired with any other. With K + dK and
M + dM, e_sr changes by -phi_s' (dK - lambda_r dM) Phi a_r / (omega_s omega_r) for given a_r, whatever the size of
the change (modal dynamic residual; Yuen, Beck and Katafygiotis 2006).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
import scipy.linalg as la
from numpy.typing import NDArray

from updating.inference.gradient import Latent
from updating.inference.protocol import Modal, State

Vector = NDArray[np.float64]

WIDE = 1.0
"""Equation error that is possible before anything is known, and that of a measured mode which the model lacks."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Errors:
    """Equation errors of the measured modes of one state, and their dependence on the coordinates of a fit.

    Attributes
    ----------
    value : (n, m) float
        e, by measured mode and equation.
    weight : (n, m) float
        Modal coordinates a, of unit length, shrunk by the discrepancy: by these it acts.
    noise : (n, m, m) float
        Covariance of e by the noise of shapes and frequencies.
    jacobian : (n, m, n_coordinate) float
        Derivatives of e.
    log_maps : (n,) float
        Logarithm of the density of (lambda_r, u_r) over that of e, by measured mode; it includes the part of the shapes
        that no mode reaches.
    curvature : (n, n_coordinate, n_coordinate) float
        Gauss and Newton's Hessian of half the square of that part, over the noise, by measured mode.
    damping : (n,) float
        Logarithm of measured over modelled damping ratio; NaN where damping is not compared.
    damping_std : (n,) float
        Its standard deviation by noise.
    damping_jacobian : (n, n_coordinate) float
        Its derivatives.
    eigenvalue : (n,) float
        Measured, (rad/s)**2.
    modelled : (n, m) float
        The model's, as each measured mode meets them.
    shape : (n_basis, m) float
        The model's modes, as `Modal` has them.
    touched : (n_coordinate,) int, optional
        Which coordinates of the fit these are, where a state depends on a few of many.
    latent : Latent
        What shapes alone say of the modal coordinates, from which the gradient of the cost follows.
    """

    value: Vector
    weight: Vector
    noise: Vector
    jacobian: Vector
    log_maps: Vector
    curvature: Vector
    damping: Vector
    damping_std: Vector
    damping_jacobian: Vector
    eigenvalue: Vector
    modelled: Vector
    shape: Vector
    latent: Latent
    touched: NDArray[np.intp] | None = None

    def beside(self, pull: Vector, inverse: Vector) -> Vector:
        """Return the gradient of the cost less the slope of errors at a fixed covariance, by mode.

        Parameters
        ----------
        pull, inverse : (n, m) and (n, m, m)
            As `updating.inference.gradient.Latent` takes them.

        Returns
        -------
        (n, n_coordinate) float
            The difference.
        """
        whole = self.latent.gradient(pull, inverse, self.jacobian.shape[2])
        return np.asarray(whole - np.einsum("rs,rsp->rp", pull, self.jacobian))

    @property
    def inertia(self) -> Vector:
        """omega_r / omega_s, (n, m), by which a change of the mass acts: 1 of rigid modes."""
        modelled = np.where(self.modelled > 0.0, self.modelled, self.eigenvalue[:, None])
        return np.asarray(np.sqrt(self.eigenvalue[:, None] / modelled))

    @property
    def log_map(self) -> float:
        """Sum of `log_maps` over all modes."""
        return float(np.sum(self.log_maps))

    @property
    def frequency(self) -> Vector:
        """Logarithm of measured over modelled frequency, (n,).

        Half the Rayleigh quotient of the errors is (omega_r / omega_s - omega_s / omega_r) / 2 of a mode s.
        """
        return np.asarray(np.arcsinh(0.5 * np.sum(self.value * self.weight, axis=1)))

    @property
    def partners(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Measured modes and the model's modes that have the largest part in them, each taken once, (n,) and (n,).

        For print only; no decision depends on it.
        """
        part = np.where(self.modelled > 0.0, self.weight**2, -1.0)
        row, column = scipy.optimize.linear_sum_assignment(part, maximize=True)
        return row, column

    @property
    def paired(self) -> Vector:
        """Logarithm of measured frequency over that of its partner among the model's modes, (n,).

        A mode that has no partner with the largest part in it, a mixture, is compared as `frequency` has it.
        """
        row, column = self.partners
        paired = 0.5 * np.log(self.eigenvalue[row] / self.modelled[row, column])
        return np.asarray(np.where(self.weight[row, column] ** 2 > 0.5, paired, self.frequency))


def shape_noise(state: State, modal: Modal, *, least: float = 1e-4, share: float = 0.7) -> Vector:
    """Return the standard deviation of a component of each measured shape, (n,), by what no mode of the model reaches.

    It is estimated once for all fits that are compared: a fit must not call its misfit noise. What makes the frequency
    of a mode uncertain, such as sensors that load it from run to run, also turns its shape towards those of close
    modes, measured or of the model alone, by the ratio of the uncertainty to the distance (first-order perturbation);
    modes of the model reach that.

    Parameters
    ----------
    state, modal
        What was measured, and a model near it.
    least : float
        Smallest noise, relative to a shape's length: no identification is better.
    share : float
        Smallest noise, relative to the median over the modes: no shape is much better than the others.
    """
    n_dof, m = modal.rows.shape
    coordinates = la.lstsq(modal.rows, state.shape, cond=1e-3)[0]
    rest = state.shape - modal.rows @ coordinates
    rough = np.sqrt(np.sum(rest**2, axis=0) / max(n_dof - m, 1))
    floor = max(share * float(np.median(rough)), least / np.sqrt(n_dof))
    modelled = np.sqrt(np.maximum(modal.eigenvalue, 0.0)) / (2.0 * np.pi)
    uncertain = np.hypot(state.frequency_std[:, None], np.concatenate([state.frequency_std, np.zeros(m)]))
    apart = np.abs(state.frequency[:, None] - np.concatenate([state.frequency, modelled]))
    np.fill_diagonal(apart, np.inf)
    known = np.argmax(np.abs(coordinates), axis=0)  # of the model's modes, those that were measured
    apart[:, state.frequency.size + known] = np.inf
    turned = np.sqrt(np.sum((uncertain / np.hypot(uncertain, apart)) ** 2, axis=1) / n_dof)
    return np.asarray(np.hypot(np.hypot(np.maximum(rough, floor), state.shape_std), turned))


def may_be_unseen(state: State, modal: Modal, *, near: float = 0.05, faint: float = 0.1) -> NDArray[np.bool_]:
    """Return which measured modes may be one of the model's that the sensors do not see, (n,).

    Such a mode moves across the sensors. What little they measure of it, small couplings bring that no model has, so
    that its shape says nothing of the modal coordinates.

    Parameters
    ----------
    state, modal
        What was measured, and a model near it.
    near : float
        Logarithm of the ratio of frequencies within which a measured mode may be that of the model.
    faint : float
        Motion at the sensors, relative to the median over the model's elastic modes, below which they do not see one.
    """
    elastic = modal.eigenvalue[modal.n_rigid :]
    motion = np.linalg.norm(modal.rows[:, modal.n_rigid :], axis=0)
    unseen = np.sqrt(elastic[motion < faint * np.median(motion)]) / (2.0 * np.pi)
    away = np.abs(np.log(state.frequency[:, None] / unseen))
    return np.asarray(np.min(away, axis=1, initial=np.inf) < near)


def equation_errors(
    state: State,
    modal: Modal,
    noise: Vector,
    n_coordinate: int,
    apart: Sequence[int] = (),
    *,
    usual: float = 0.03,
    wide: float = WIDE,
    rest: float = 1e-3,
    exact: float = 1e-6,
) -> Errors:
    """Put the measured modes of a state into the equations of a model.

    Parameters
    ----------
    state, modal
        What was measured, and the model.
    noise : (n,)
        Standard deviation of a component of each shape of unit length.
    n_coordinate : int
        Number of coordinates of the fit.
    apart : sequence of int
        Measured modes that are none of the model's: the standard deviation of their equation errors and logarithms of
        damping ratios is `wide`.
    usual : float
        Equation error that models usually have, by which the coordinates that weigh errors are shrunk: noisy ones
        bias the weights. An order above the median discrepancy.
    wide : float
        Equation error that is possible before anything is known: what sensors do not see stays unknown.
    rest : float
        Relative standard deviation of a damping ratio that no identification is better than.
    exact : float
        Equation error to which the model's own arithmetic is right, for a mode exactly at the frequency of another.
    """
    m, n = modal.eigenvalue.size, state.frequency.size
    n_coordinate = n_coordinate if modal.touched is None else modal.touched.size
    lam, omega = (2.0 * np.pi * state.frequency) ** 2, 2.0 * np.pi * state.frequency
    gap, scale = _gaps(modal, omega)

    gram, seen = modal.rows.T @ modal.rows, (modal.rows.T @ state.shape).T  # (m, m), (n, m)
    length = np.linalg.norm(la.lstsq(modal.rows, state.shape, cond=1e-3)[0], axis=0)  # alpha

    for _ in range(2):
        weight, _, _ = _coordinates(gram, seen, length, noise, gap, usual)
        size = np.linalg.norm(weight, axis=1)
        length, weight = length * size, weight / size[:, None]
    a, inverse, covariance = _coordinates(gram, seen, length, noise, gap, wide)

    value = gap * a
    of_noise = gap[:, :, None] * covariance * gap[:, None, :]
    if modal.of_mode is not None:
        value = value - np.einsum("rij,rj->ri", modal.of_mode, a) / scale
    frequency_variance = (2.0 * state.frequency_std / state.frequency) ** 2 + 1e-9
    of_noise[:, np.arange(m), np.arange(m)] += frequency_variance[:, None] * weight**2 + exact**2

    jacobian = _driven(modal, lam, scale, weight, n_coordinate)
    look = _look(modal, lam, weight, n_coordinate)
    sure = (length / noise) ** 2
    da = -np.einsum("rij,rpj->rpi", covariance, look @ modal.rows) * sure[:, None, None]
    turned = -(look + da @ modal.rows.T) * np.sqrt(sure)[:, None, None]
    turned[list(apart)] = 0.0
    curvature = turned @ turned.transpose(0, 2, 1)
    da -= weight[:, None, :] * np.einsum("ri,rpi->rp", weight, da)[:, :, None]
    jacobian += (gap[:, None, :] * da).transpose(0, 2, 1)

    looked = np.ones(n, dtype=bool)
    looked[list(apart)] = False
    latent = Latent(
        modal=modal,
        eigenvalue=lam,
        mean=a,
        covariance=covariance,
        weight=weight,
        gap=gap,
        scale=scale,
        shape=state.shape.T / length[:, None],
        sure=sure,
        looked=looked,
    )
    loss, damping_jacobian = _loss(state, modal, weight, n_coordinate)
    errors = Errors(
        value=value,
        weight=weight,
        noise=of_noise,
        jacobian=jacobian,
        log_maps=_log_maps(latent, inverse, state, noise),
        curvature=curvature,
        damping=np.log(state.damping / (loss / (2.0 * omega))),
        damping_std=np.hypot(state.damping_std / state.damping, rest),
        damping_jacobian=damping_jacobian,
        eigenvalue=lam,
        modelled=_met(modal, n),
        shape=modal.shape,
        touched=modal.touched,
        latent=latent,
    )
    return apart_from(errors, old=(), new=apart, wide=wide)


def _log_maps(latent: Latent, inverse: Vector, state: State, noise: Vector) -> Vector:
    """Return the logarithms of the density of (lambda_r, u_r) over that of e, (n,).

    `inverse` is that of the covariance of the modal coordinates.
    """
    misfit = np.sum(state.shape**2, axis=0) / noise**2
    misfit -= np.einsum("ri,rij,rj->r", latent.mean, inverse, latent.mean)
    stretch = np.abs(np.sum(latent.weight**2 / (latent.gap * latent.scale), axis=1) * latent.eigenvalue)
    within = 0.5 * (np.linalg.slogdet(latent.covariance)[1] - misfit)
    return np.asarray(np.sum(np.log(np.abs(latent.gap)), axis=1) + np.log(stretch) + within)


def apart_from(errors: Errors, *, old: Sequence[int], new: Sequence[int], wide: float = WIDE) -> Errors:
    """Return errors with modes `new`, not `old`, set apart: `wide` is the standard deviation of their errors."""
    noise, damping_std = errors.noise.copy(), errors.damping_std.copy()
    for sign, modes in ((-1.0, old), (1.0, new)):
        for r in modes:
            a = errors.weight[r]
            noise[r] += sign * wide**2 * (np.eye(a.size) + np.outer(a, a))
            damping_std[r] = np.sqrt(damping_std[r] ** 2 + sign * wide**2)
    return replace(errors, noise=noise, damping_std=damping_std)


def _driven(modal: Modal, lam: Vector, scale: Vector, weight: Vector, n_coordinate: int) -> Vector:
    """Return -phi_s' (dK - lambda_r dM) Phi a_r / (omega_s omega_r), (n, m, n_coordinate)."""
    n, m = weight.shape
    jacobian = np.zeros((n, m, n_coordinate))
    if modal.moves.size:
        force = np.einsum("qij,rj->rqi", modal.stiffness, weight)
        force -= lam[:, None, None] * np.einsum("qij,rj->rqi", modal.mass, weight)
        jacobian[:, :, modal.moves] = -(force / scale[:, None, :]).transpose(0, 2, 1)
    if modal.of_mode_moves.size:
        force = np.einsum("srij,rj->rsi", modal.of_mode_change, weight)
        jacobian[:, :, modal.of_mode_moves] -= (force / scale[:, None, :]).transpose(0, 2, 1)
    return jacobian


def _met(modal: Modal, n: int) -> Vector:
    """Return the model's eigenvalues as each measured mode meets them, (n, m)."""
    eigenvalue = np.tile(modal.eigenvalue, (n, 1))
    if modal.of_mode is not None:
        eigenvalue[:, modal.n_rigid :] += np.einsum("rii->ri", modal.of_mode)[:, modal.n_rigid :]
    return eigenvalue


def _coordinates(
    gram: Vector, seen: Vector, length: Vector, noise: Vector, gap: Vector, width: float
) -> tuple[Vector, Vector, Vector]:
    """Return a, its inverse covariance and covariance where equation errors have a standard deviation `width`."""
    prior = np.clip(width / np.abs(gap), 0.02, 3.0) ** -2.0
    sure = (length / noise) ** 2
    inverse = gram * sure[:, None, None] + prior[:, :, None] * np.eye(len(gram))
    half = np.linalg.inv(np.linalg.cholesky(inverse))  # its square stays positive where the inverse by itself may not
    covariance = half.transpose(0, 2, 1) @ half
    a = np.einsum("rij,rj->ri", covariance, seen) * (length / noise**2)[:, None]
    return a, inverse, covariance


def _gaps(modal: Modal, omega: Vector) -> tuple[Vector, Vector]:
    """Return how far each measured mode is from each equation, never quite 0, and what it is relative to, (n, m)."""
    elastic = np.arange(modal.eigenvalue.size) >= modal.n_rigid
    modelled = np.where(elastic, np.sqrt(np.maximum(modal.eigenvalue, 0.0)), np.nan)
    scale = omega[:, None] * np.where(elastic, modelled, omega[:, None])
    gap = (omega[:, None] ** 2 - modal.eigenvalue) / scale
    return np.where(np.abs(gap) < 1e-9, 1e-9, gap), scale


def scales(state: State, modal: Modal) -> Vector:
    """Return what each equation error of each measured mode is relative to, (n, m), (rad/s)**2."""
    return _gaps(modal, 2.0 * np.pi * state.frequency)[1]


def _loss(state: State, modal: Modal, weight: Vector, n_coordinate: int) -> tuple[Vector, Vector]:
    """Return a' C a of each measured mode, (n,), and minus the derivatives of its logarithm, (n, n_coordinate).

    Of unit length by the modal mass, a gets shorter as that grows.
    """
    n, m = weight.shape
    omega = 2.0 * np.pi * state.frequency
    damping = np.broadcast_to(modal.damping, (n, m, m))
    loss = np.einsum("ri,rij,rj->r", weight, damping, weight)
    # At least a thousandth of what is measured, so that a model without damping has a logarithm, too.
    loss = np.maximum(loss, 2e-3 * omega * np.where(np.isfinite(state.damping), state.damping, 1.0))
    jacobian = np.zeros((n, n_coordinate))
    if modal.damps.size:
        change = np.broadcast_to(modal.damping_change, (modal.damps.size, n, m, m))
        jacobian[:, modal.damps] = -np.einsum("ri,prij,rj->rp", weight, change, weight) / loss[:, None]
    if modal.moves.size:
        jacobian[:, modal.moves] += np.einsum("ri,qij,rj->rq", weight, modal.mass, weight, optimize=True)
    return loss, jacobian


def _look(modal: Modal, lam: Vector, weight: Vector, n_coordinate: int) -> Vector:
    """Return how Psi a changes at given a, (n, n_coordinate, n_dof): as further modes take part, and as rows change."""
    look = np.zeros((len(weight), n_coordinate, len(modal.rows)))
    if modal.moves.size:
        beyond = np.einsum("qij,rj->rqi", modal.beyond_stiffness, weight)
        beyond -= lam[:, None, None] * np.einsum("qij,rj->rqi", modal.beyond_mass, weight)
        look[:, modal.moves] = (beyond / (lam[:, None] - modal.beyond)[:, None, :]) @ modal.beyond_rows.T
    if modal.looks.size:
        look[:, modal.looks] += np.einsum("kdm,rm->rkd", modal.row_change, weight)
    return look
