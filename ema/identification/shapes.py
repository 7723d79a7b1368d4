"""Mode shapes from residues, mass-normalised where a driving point allows it, of modes that share a pole too.

The residues of one mode are the outer product of its shape and its participation in the forces, a matrix of rank one
(Ewins, Modal Testing, 2nd ed., sec. 2.8; polyreference LSFD, Heylen, Lammens and Sas, Modal Analysis Theory and
Testing, part A). Modes of one frequency, as symmetric structures have them, leave a matrix ``U V^T`` of higher rank,
whatever their shapes. With ``delta_k`` the distances of their poles from the common one,

    sum_k A_k / (s - pole - delta_k) = U V^T / (s - pole) + U M V^T / (s - pole)**2 + ...,

the eigenvalues of ``M`` are the distances, and its eigenvectors mix ``U`` and ``V`` to shapes and participations
(perturbation of a multiple eigenvalue; Lancaster, Numer. Math. 6, 1964). ``M`` is seen in all functions at once, so a
split far below the bandwidth shows. Reciprocity makes shapes and participations the same at driving points: then ``M``
is symmetric and its eigenvectors are a rotation, so that shapes stay independent whatever noise does to it. Without
driving points the shapes are taken as orthogonal over the measured points. From there poles and rotation minimise the
misfit of the modes themselves, not of their series; shapes and a smooth part are eliminated (variable projection).

A fit in which every function has residues of its own sees one pole where modes coincide and, where they hardly differ,
two with residues of large and opposite errors, or a third. Where forces act at several points, the rank of the residues
says how many modes there are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy
import scipy.linalg

from ema.identification.evidence import FALSE_ALARM, MIN_COLLINEARITY, MIN_REALNESS, inflation
from ema.types.frf import DERIVATIVE, FRF, Dofs, Quantity, driving_points
from ema.types.modal_model import ModalModel, synthesize
from lamella_shared import Booleans, Complexes, Integers, Reals


@dataclass(frozen=True, eq=False, kw_only=True)
class Shapes:
    """Shapes of all modes at the outputs.

    Attributes
    ----------
    shape : (n_output, n_mode) complex
        1/sqrt(kg) for modes that are `scaled`, else of unit largest component.
    std : (n_output, n_mode) float
        Standard deviation of each component's magnitude.
    scaled : (n_mode,) bool
        Which modes have a valid driving point.
    """

    shape: Complexes
    std: Reals
    scaled: Booleans


def shapes_from_residues(
    pole: Complexes,
    residue: Complexes,
    variance: Reals,
    output: Dofs,
    inputs: Dofs,
    *,
    phase_tolerance: float = np.pi / 4,
    least_strength: float = 3.0,
) -> Shapes:
    """Draw shapes from residues; with a valid driving point they are mass-normalised.

    The residue of a mass-normalised real mode is ``phi_o phi_i / (2 i omega_d)``, so that the modal constant
    ``2 i omega_d A`` of a driving point is ``phi**2``, positive for a passive structure (Ewins, Modal
    Testing, 2nd ed., sec. 2.8). A driving-point constant more than 45 degrees off the positive axis means a
    wrong sign, a wrong point or no signal, and is refused for scaling. Each mode is judged by itself: a driving
    point near a nodal line of one mode leaves the others their scale.

    Parameters
    ----------
    pole : (n_mode,) complex
        Poles, rad/s.
    residue : (n_output, n_input, n_mode) complex
        Residues of the receptance, m/(N s).
    variance : (n_output, n_input, n_mode) float
        Variance of each residue's component along its own phase.
    output, inputs : Dofs
        Where responses and forces are.
    phase_tolerance : float
        Largest phase of a driving-point modal constant that still counts as positive.
    least_strength : float
        Least driving-point modal constant that gives a scale, in standard deviations.
    """
    n_output, _, n_mode = residue.shape
    shape = np.zeros((n_output, n_mode), dtype=complex)
    std = np.zeros((n_output, n_mode))
    scaled = np.zeros(n_mode, dtype=bool)
    pairs = driving_points(output, inputs)
    for r in range(n_mode):
        constant = 2j * pole[r].imag * residue[:, :, r]
        constant_variance = (2.0 * pole[r].imag) ** 2 * variance[:, :, r]
        left, singular, right = np.linalg.svd(constant)
        # The constants are the outer product shape x participation; the right vector weighs the inputs.
        column = left[:, 0] * singular[0]
        column_std = np.sqrt(constant_variance @ np.abs(right[0]) ** 2)
        participation = right[0]
        best, factor = 0.0, 1.0 / column[np.argmax(np.abs(column))]
        for o, i, sign in pairs:
            square = sign * column[o] * participation[i]
            strength = np.abs(square) / (column_std[o] * np.abs(participation[i]) + np.finfo(float).tiny)
            if strength > max(best, least_strength) and np.abs(np.angle(square)) < phase_tolerance:
                # shape_o = sign * shape_i at the point, hence phi_i = sqrt(sign * constant) up to a sign.
                best, factor = strength, participation[i] / np.sqrt(square)
                scaled[r] = True
        shape[:, r] = column * factor
        # The driving-point component enters twice; its relative error is halved by the square root.
        relative = 0.5 / best if scaled[r] else 0.0
        std[:, r] = np.hypot(column_std * np.abs(factor), relative * np.abs(shape[:, r]))
    return Shapes(shape=shape, std=std, scaled=scaled)


@dataclass(frozen=True, eq=False, kw_only=True)
class Around:
    """Functions around a pole, less what other modes add to them, over their noise.

    Attributes
    ----------
    frequency : (n_line,) float
        Lines, Hz.
    quantity : {"receptance", "mobility", "accelerance"}
    value : (n_output, n_input, n_line) complex
        The functions over the noise.
    output_noise, input_noise : (n_output,) and (n_input,) float
        Their product is the standard deviation of the complex noise.
    """

    frequency: Reals
    quantity: Quantity
    value: Complexes
    output_noise: Reals
    input_noise: Reals

    def line(self, pole: Complexes, power: int = 1) -> Complexes:
        """Return what modal constants ``2 i omega_d A`` of 1 at poles give, (n_pole, n_line), its smooth part out."""
        s = 2j * np.pi * self.frequency
        response = s ** DERIVATIVE[self.quantity] / (2j * pole.imag[:, None] * (s - pole[:, None]) ** power)
        return self.rough(response)

    def rough(self, value: Complexes) -> Complexes:
        """Return functions without their straight part over the lines."""
        straight = np.stack([np.ones(self.frequency.size), self.frequency - self.frequency.mean()])
        straight /= np.linalg.norm(straight, axis=1, keepdims=True)
        return np.asarray(value - (value @ straight.T) @ straight)


@dataclass(frozen=True, eq=False, kw_only=True)
class RankOneModes:
    """Modes of rank one, ascending in frequency.

    Attributes
    ----------
    pole : (n_mode,) complex
        rad/s.
    pole_std : (n_mode,) float
        Standard deviation of Re and of Im of each, rad/s.
    residue : (n_output, n_input, n_mode) complex
        Residues of the receptance, m/(N s).
    residue_std : (n_output, n_input) float
        Standard deviation of them at fixed poles and rotation.
    angle_std : float
        Standard deviation, rad, of the rotation of the shapes in their subspace.
    left : float
        Power of what the modes leave of the functions.
    """

    pole: Complexes
    pole_std: Reals
    residue: Complexes
    residue_std: Reals
    angle_std: float
    left: float


@dataclass(frozen=True, eq=False, kw_only=True)
class _Factors:
    """Real parts of the modal constants of a pole over their noise, ``left @ right.T``, columns alike in length."""

    left: Reals  # (n_output, n_mode)
    right: Reals  # (n_input, n_mode)


def rank_one_modes(around: Around, pole: complex, pairs: list[tuple[int, int, float]], most: int) -> RankOneModes:
    """Find the modes that share a pole, one at least.

    Parameters
    ----------
    around : Around
        Functions that hold these modes and no other.
    pole : complex
        The common pole, rad/s.
    pairs : list of (int, int, float)
        Driving points: output, input, and the product of their signs.
    most : int
        How many modes there may be.
    """
    factors = _factors(around, pole, most)
    mixing = _common_basis(factors, around, pairs)
    matrix = np.linalg.solve(mixing, _distances(around, pole, factors) @ mixing)
    # Where shapes and participations are the same, so are the matrix and its transpose.
    symmetric = 0.5 * (matrix + matrix.T)
    rotation = np.linalg.eigh(symmetric.imag)[1]
    participation = factors.right @ np.linalg.inv(mixing @ rotation).T
    start = pole + np.diag(rotation.T @ symmetric @ rotation)
    return _refined(around, factors, start, participation)


def _factors(around: Around, pole: complex, most: int, *, least_part: float = 0.02) -> _Factors:
    """Factor modal constants into as many modes as stand out of the noise, one at least and some at most.

    `least_part`: part of a second mode in the residues, relative to the first, below which it may be an error of the
    measurement.
    """
    line = around.line(np.array([pole]))[0]
    constant: Complexes = around.value @ line.conj() / np.linalg.norm(line) ** 2
    rest = around.rough(around.value) - constant[..., None] * line
    grown = inflation(rest.reshape(-1, line.size))
    variance = 0.5 * grown / float(np.linalg.norm(line)) ** 2  # of either part
    left, gain, right = np.linalg.svd(constant, full_matrices=False)
    n_output, n_input = constant.shape
    n = 1
    while n < min(gain.size, most):
        freedom = 2 * (n_output - n) * (n_input - n)
        beyond = float(np.sum(gain[n:] ** 2)) > variance * scipy.special.chdtri(freedom, FALSE_ALARM)
        part = gain[n] * np.outer(left[:, n], right[n])
        if not beyond or gain[n] < least_part * gain[0] or not _real(part, variance):
            break
        strong, weak = (np.abs(around.output_noise * left[:, k] * gain[k]) for k in (0, n))
        if not _is_additive(strong, weak, np.sqrt(variance) * around.output_noise):
            break
        n += 1
    by_output, size, by_input = np.linalg.svd(constant.real, full_matrices=False)
    root = np.sqrt(size[:n])
    return _Factors(left=by_output[:, :n] * root, right=by_input[:n].T * root)


def _real(constant: Complexes, variance: float) -> bool:
    """Whether modal constants of rank one, each part of them with a variance, lie on the real axis as a mode's do."""
    noise = variance * (sum(constant.shape) - 1)
    real, imaginary = (float(np.sum(part**2)) - noise for part in (constant.real, constant.imag))
    total = real + imaginary
    distance = np.hypot(real - imaginary, 2.0 * float(np.sum(constant.real * constant.imag)))
    return total > 0.0 and distance**2 >= MIN_COLLINEARITY * total**2 and real >= MIN_REALNESS * total


def _is_additive(
    strong: Reals, weak: Reals, noise: Reals, *, least_likelier: float = 2.0, largest_error: float = 0.1
) -> bool:
    """Whether a weak part of the modal constants is one of a mode, and not an error of gains or of places hit.

    Such errors grow with the response of the strong part and are nothing where that is at rest; a mode shows there.
    Returned is which of both variances over the outputs, ``(n_output,)``, is likelier.

    `least_likelier`: log-likelihood by which a second mode is to explain a second part of the residues better than
    errors of gains.
    `largest_error`: errors of gains of single functions, relative, that are thought possible.
    """

    def log_likelihood(std: Reals) -> float:
        variance = std**2 + noise**2
        return float(np.max(-0.5 * np.sum(np.log(variance) + weak**2 / variance, axis=1)))

    size = np.geomspace(0.1, 10.0, 41)[:, None] * np.sqrt(np.mean(weak**2))
    error = np.geomspace(1e-3, largest_error, 41)[:, None]
    additive = log_likelihood(size * np.ones(weak.size))
    return additive > log_likelihood(error * strong) + least_likelier


def _common_basis(
    factors: _Factors, around: Around, pairs: list[tuple[int, int, float]], *, least_definite: float = 1e-3
) -> Reals:
    """Mixing X of the columns that makes shapes ``left X`` and participations ``right X**-T`` the same.

    At driving points that is ``left S = right`` with the symmetric ``S = X X^T``. Where they do not tell it, X makes
    the shapes orthogonal.

    `least_definite`: least over largest eigenvalue of what driving points say of the scale of shapes, for it to be
    used.
    """
    left, right = around.output_noise[:, None] * factors.left, around.input_noise[:, None] * factors.right
    n = left.shape[1]
    row, column = np.triu_indices(n)
    if len(pairs) * n >= row.size:
        unit = np.zeros((row.size, n, n))
        unit[np.arange(row.size), row, column] = unit[np.arange(row.size), column, row] = 1.0
        o, i, sign = (np.array(part) for part in zip(*pairs, strict=True))
        equations = (left[o] @ unit).reshape(row.size, -1).T
        known = (sign[:, None] * right[i]).reshape(-1)
        square = np.tensordot(np.linalg.lstsq(equations, known, rcond=None)[0], unit, axes=1)
        value = np.linalg.eigvalsh(square)
        if value[0] > least_definite * value[-1]:
            return np.linalg.cholesky(square)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(left.T @ left)).T)


def _distances(around: Around, pole: complex, factors: _Factors) -> Complexes:
    """Return M of the module's equation, rad/s: the functions seen along the factors have it in a double pole."""
    square = np.sum(factors.left**2, axis=0)  # as of `right`
    seen = np.einsum("ok,oif,il->klf", factors.left, around.value, factors.right) / np.outer(square, square)[..., None]
    basis = np.concatenate([around.line(np.array([pole]), power) for power in (2, 1)])
    n = square.size
    solution = np.linalg.lstsq(basis.T, around.rough(seen).reshape(n * n, -1).T, rcond=None)[0]
    return np.asarray(solution[0].reshape(n, n))


def _rotation(angle: Reals, n: int) -> Reals:
    """Return the rotation by small angles in each pair of `n` axes."""
    skew = np.zeros((n, n))
    skew[np.triu_indices(n, 1)] = angle
    return np.asarray(scipy.linalg.expm(skew - skew.T))


def _refined(
    around: Around, factors: _Factors, start: Complexes, participation: Reals, *, unknown_angle: float = np.pi / 4.0
) -> RankOneModes:
    """Minimise the misfit over poles and a rotation of the participations, from a start.

    `unknown_angle`: standard deviation, rad, of a rotation that nothing tells: any shape of the subspace is as good.
    """
    from scipy.optimize import least_squares  # here: it takes long to import, and few structures are symmetric

    n, width = start.size, float(np.mean(-start.real))
    side = factors.left / np.linalg.norm(factors.left, axis=0)
    seen = around.rough(np.einsum("ok,oif->kif", side, around.value)).reshape(n, -1)

    def unpacked(x: Reals) -> tuple[Complexes, Reals]:
        pole = start + width * (x[:n] + 1j * x[n : 2 * n])
        return pole, participation @ _rotation(x[2 * n :], n)

    def basis(x: Reals) -> Complexes:
        pole, turned = unpacked(x)
        return np.asarray((turned.T[:, :, None] * around.line(pole)[:, None, :]).reshape(n, -1))

    def misfit(x: Reals) -> Reals:
        orthogonal = np.linalg.qr(basis(x).T)[0]
        rest = seen - (seen @ orthogonal.conj()) @ orthogonal.T
        return np.concatenate([rest.real.ravel(), rest.imag.ravel()])

    solution = least_squares(misfit, np.zeros(2 * n + n * (n - 1) // 2), method="lm")
    pole, turned = unpacked(solution.x)
    x = solution.x
    if np.any(pole.real >= 0.0) or np.any(np.abs(pole - start) > width):
        pole, turned, x = start, participation, np.zeros(solution.x.size)
    shape = np.linalg.lstsq(basis(x).T, around.rough(around.value).reshape(len(factors.left), -1).T, rcond=None)[0].T
    rest = around.rough(around.value) - np.einsum("ok,ik,kf->oif", shape, turned, around.line(pole))
    grown = inflation(rest.reshape(-1, rest.shape[-1]))
    information = solution.jac.T @ solution.jac / (0.5 * grown)
    # What nothing tells has an infinite variance, a rotation of modes of exactly one pole first of all.
    value, vector = np.linalg.eigh(information)
    std = np.sqrt((vector**2) @ (1.0 / np.maximum(value, 1.0)))
    rank = np.argsort(np.abs(pole))
    line = np.linalg.norm(around.line(np.array([pole.mean()])))
    noise = np.outer(around.output_noise, around.input_noise)
    residue = np.einsum("ok,ik->oik", shape, turned)[..., rank] * noise[..., None] / (2j * pole.imag[rank])
    return RankOneModes(
        pole=pole[rank],
        pole_std=width * np.maximum(std[:n], std[n : 2 * n])[rank],
        residue=residue,
        residue_std=noise * np.sqrt(0.5 * grown) / (line * 2.0 * np.mean(pole.imag)),
        angle_std=float(min(std[2 * n :].max(initial=0.0), unknown_angle)),
        left=float(np.sum(np.abs(rest) ** 2)),
    )


ALIKE = 0.9
"""MAC from which on neighbouring poles are one mode."""


def with_repeated_roots(model: ModalModel, frf: FRF) -> ModalModel:
    """Put the modes that share a pole in the place of that pole.

    Parameters
    ----------
    model : ModalModel
        What was identified.
    frf : FRF
        The functions that it was identified from, on the lines of its band.

    Returns
    -------
    ModalModel
        The same one where there is one input, or where the residues of every pole are those of one mode.
    """
    if model.input.node.size == 1:
        return model
    pairs = driving_points(Dofs(node=model.node, direction=model.direction), model.input)
    rest = synthesize(model, frf.frequency, frf.quantity)
    np.subtract(frf.value, rest, out=rest)
    noise = np.log(np.sqrt(np.mean(np.abs(rest) ** 2, axis=-1)) + np.finfo(float).tiny)
    noises = np.exp(noise.mean(axis=1)), np.exp(noise.mean(axis=0) - noise.mean())
    for members in reversed(list(_clusters(model.pole))):
        around, left = _around(model, members, frf, rest, noises)
        size = np.linalg.norm(model.residue[..., members], axis=(0, 1)) / -model.pole[members].real
        pole = complex(np.average(model.pole[members], weights=size))
        modes = rank_one_modes(around, pole, pairs, model.input.node.size)
        if modes.pole.size > 1 and (members.size == 1 or _as_good(modes, left, around, members.size)):
            model = _with_modes(model, members, modes)
        elif members.size > 1 and _alike(model.residue[..., members]):
            model = _with_modes(model, members, rank_one_modes(around, pole, pairs, 1))
    return model


def _alike(residue: Complexes) -> bool:
    """Whether neighbouring modes have one shape: a mode whose frequency is another one with each force."""
    shape = np.stack([np.linalg.svd(one)[0][:, 0] for one in np.moveaxis(residue, -1, 0)])
    return bool(np.all(np.abs(np.sum(shape[1:].conj() * shape[:-1], axis=1)) ** 2 > ALIKE))


def _clusters(pole: Complexes, *, near: float = 1.0) -> Iterator[Integers]:
    """Yield the positions of poles that are near each other, of one alone, too.

    `near`: half bandwidths within which residues of two poles are taken together: beyond, each pole has certain ones.
    """
    first = 0
    for r in range(1, pole.size + 1):
        if r == pole.size or np.abs(pole[r] - pole[r - 1]) > -near * max(pole.real[r], pole.real[r - 1], key=abs):
            yield np.arange(first, r)
            first = r


def _around(
    model: ModalModel,
    members: Integers,
    frf: FRF,
    rest: Complexes,
    noises: tuple[Reals, Reals],
    *,
    window: float = 10.0,
    fewest_lines: int = 16,
) -> tuple[Around, float]:
    """Return the functions around modes, less all other ones, and the power of what the model leaves of them.

    `window`, `fewest_lines`: half bandwidths on each side of a pole over which its modes are sought.
    """
    spacing = 2.0 * np.pi * (frf.frequency[1] - frf.frequency[0])
    reach = int(max(np.ceil(window * -model.pole[members].real.min() / spacing), fewest_lines))
    middle = int(np.argmin(np.abs(2.0 * np.pi * frf.frequency - model.pole[members].imag.mean())))
    lines = slice(max(0, middle - reach), middle + reach + 1)
    s = 2j * np.pi * frf.frequency[lines]
    pole, residue = model.pole[members], model.residue[..., members]
    response = residue @ (s ** DERIVATIVE[frf.quantity] / (s - pole[:, None]))
    noise = np.outer(*noises)[..., None]
    around = Around(
        frequency=frf.frequency[lines],
        quantity=frf.quantity,
        value=(rest[..., lines] + response) / noise,
        output_noise=noises[0],
        input_noise=noises[1],
    )
    return around, float(np.sum(np.abs(around.rough(rest[..., lines] / noise)) ** 2))


def _as_good(modes: RankOneModes, left: float, around: Around, n_before: int) -> bool:
    """Whether modes of rank one explain the functions as well as poles with free residues, which have more unknowns."""
    n_function = around.value[..., 0].size
    n_output, n_input = around.value.shape[:2]
    saved = 2 * n_before * (n_function + 1) - 2 * modes.pole.size * (n_output + n_input)
    freedom = 2 * around.value.size - 2 * n_before * (n_function + 1)
    grown = max(left / (0.5 * freedom), np.finfo(float).tiny)
    return 2.0 * (modes.left - left) / grown < scipy.special.chdtri(max(saved, 1), FALSE_ALARM)


def _with_modes(model: ModalModel, members: Integers, modes: RankOneModes) -> ModalModel:
    """Replace modes of a model by others."""
    n, first = modes.pole.size, int(members[0])
    new = np.arange(first, first + n)
    # Of each mode after: which one before it comes from.
    nearest = members[np.minimum(np.arange(n) * members.size // n, members.size - 1)]
    index = np.concatenate([np.arange(first), nearest, np.arange(members[-1] + 1, model.pole.size)])
    pole = model.pole[index]
    pole[new] = modes.pole
    free = model.free_pole[index] + (pole - model.pole[index])
    residue = model.residue[..., index]
    residue[..., new] = modes.residue
    residue_std = model.residue_std[..., index]
    residue_std[..., new] = modes.residue_std[..., None]
    output = Dofs(node=model.node, direction=model.direction)
    shapes = shapes_from_residues(modes.pole, modes.residue, residue_std[..., new] ** 2, output, model.input)
    # A rotation adds to each shape a share of the others.
    turned = modes.angle_std * (np.abs(shapes.shape).sum(axis=1, keepdims=True) - np.abs(shapes.shape))
    parts = np.stack([2 * index, 2 * index + 1], axis=1).reshape(-1)
    covariance = model.covariance[np.ix_(parts, parts)]
    changed = np.arange(2 * first, 2 * (first + n))
    covariance[changed], covariance[:, changed] = 0.0, 0.0
    covariance[changed, changed] = np.repeat(modes.pole_std, 2) ** 2
    std = {name: getattr(model, name)[index] for name in ("frequency_std", "damping_std")}
    std["frequency_std"][new] = modes.pole_std / (2.0 * np.pi)
    std["damping_std"][new] = modes.pole_std / np.abs(modes.pole)
    shape = {name: getattr(model, name)[:, index] for name in ("shape", "shape_std")}
    shape["shape"][:, new], shape["shape_std"][:, new] = shapes.shape, np.hypot(shapes.std, turned)
    scaled = model.scaled[index]
    scaled[new] = shapes.scaled
    run = ("run_frequency_std", "run_damping_std", "run_probability")
    return replace(
        model,
        frequency=np.abs(free) / (2.0 * np.pi),
        damping=-free.real / np.abs(free),
        pole=pole,
        residue=residue,
        residue_std=residue_std,
        covariance=covariance,
        scaled=scaled,
        run_pole=model.run_pole[:, index] + (pole - model.pole[index]),
        **std,
        **shape,
        **{name: getattr(model, name)[:, index] for name in run},
    )
