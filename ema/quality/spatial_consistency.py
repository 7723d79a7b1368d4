"""Channels whose sign, phase or size contradicts the others: turned, delayed, scaled or exchanged.

At a resonance the functions are the outer product of the mode's shape and its participation in the forces (Ewins,
Modal Testing, 2nd ed., sec. 2.8): from point to point only the size of what the forces give changes, not their
proportion. A point at which one force has the other sign at every resonance is no second mode of the same pole, which
would do so at one of them, but a function that is turned.

Every response is a combination of a few mode shapes, which vary smoothly over the structure. The shapes are
modelled as Gaussian random fields (squared-exponential covariance in the coordinates plus a linear trend,
Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, chapters 2 and 5), their length scale
and noise by maximum likelihood. A fault is believed by how much its undoing raises the likelihood.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ema.quality.peaks import peaks, residues
from ema.quality.verdict import Verdict
from ema.types.arrays import inner_products
from ema.types.frf import FRF, Geometry
from lamella_shared import Complexes, Integers, Reals


def negative_share(mobility: Complexes) -> float:
    """Return the share of the real part of a driving-point mobility that is negative."""
    real = mobility.real
    return float(-real[real < 0].sum() / max(np.abs(real).sum(), np.finfo(float).tiny))


def delay(
    mobility: Complexes, frequency: Reals, *, longest: float = 0.75, sound: float = 0.1, turned: float = 0.9
) -> float | None:
    """Return the delay of the response, s, that makes a driving point of one of negative power; None where none does.

    Parameters
    ----------
    mobility : (n_frequency,) complex
        Of a driving point, along the force.
    frequency : (n_frequency,) float
        Hz, above 0.
    longest : float
        Largest delay that is thought of, in periods of the last line: less than two samples of a usual recorder.
    sound, turned : float
        Shares of negative power below which a delay corrects a driving point, and above which a turned sign does.
    """
    n_tried = 151
    if negative_share(mobility) > turned:
        return None
    tried = np.linspace(-longest, longest, n_tried) / frequency[-1]
    share = [negative_share(mobility * np.exp(2j * np.pi * frequency * time)) for time in tried]
    best = int(np.argmin(share))
    return float(tried[best]) if share[best] < sound else None


def phases(frf: FRF, sound: Integers, *, in_phase: float = 0.7, fewest_lines: float = 0.25) -> Iterator[Verdict]:
    """Compare the phase of the residues with that of the quantity.

    Residues of real modes are imaginary in receptance and accelerance, and real in mobility, if time is counted from
    the force. Where a resonance is narrower than the lines tell, its record ends before it has died away, and the phase
    of its residues is that of the end of the record: it refuses nothing.

    `in_phase`: mean cosine of twice the angle between residues and a phase from which on they have that phase.
    `fewest_lines`: lines in a half-power bandwidth from which on a record is long enough for phases: its end turns
    them by 27 degrees at most, the angle whose sine is exp(-pi 0.25), where nothing else has faded the response out.
    """
    expected = 1.0 if frf.quantity == "mobility" else -1.0
    wrong, resolved = [], []
    for around in residues(frf, sound, peaks(frf, sound)):
        square, power = np.sum(around.residue**2).real, np.sum(np.abs(around.residue) ** 2)
        wrong.append(bool(expected * square < -in_phase * power))
        resolved.append(around.lines > fewest_lines)
    decided = np.array(wrong)[resolved] if any(resolved) else np.array(wrong)
    if decided.size < 2 or decided.sum() <= 0.75 * decided.size:
        return
    other = "mobility" if expected < 0 else "accelerance or receptance"
    text = f"given as {frf.quantity}, but {decided.sum()} of {decided.size} resonances have the phase of {other}"
    if np.count_nonzero(resolved) >= 2:
        yield Verdict(check="unit", level="fail", message=text)
    else:
        text += (
            "; they are narrower than the lines resolve, so that the end of the record may have turned it: check the "
            "quantity, and take longer blocks"
        )
        yield Verdict(check="resolution", level="warn", message=text)


FEWEST_POINTS = 6
"""Points from which on most of them say what the proportion of the forces is."""
FEWEST_RESONANCES = 2
"""Resonances at which a function must be turned."""


@dataclass(frozen=True, kw_only=True)
class TurnedFunction:
    """A function of the wrong sign.

    Attributes
    ----------
    output, input : int
        Its positions.
    resonances : tuple of float
        Where it contradicts the others, Hz.
    """

    output: int
    input: int
    resonances: tuple[float, ...]


def turned_functions(
    frf: FRF,
    channels: Integers,
    *,
    prominence: float = 3.0,
    fits: float = 0.9,
    contradicts: float = 0.5,
    most: float = 0.7,
) -> tuple[TurnedFunction, ...]:
    """Find functions that fit the proportion of the forces at no resonance, and at all of them if they are turned.

    Parameters
    ----------
    frf : FRF
        Functions of several inputs. Of two inputs nothing tells which function is turned; the first is named.
    channels : (n_channel,) int
        Outputs to be compared.
    prominence : float
        Of a resonance, dB.
    fits, contradicts : float
        Share of a point's power that has the proportion of the others.
    most : float
        Share of the points that must have it, for a resonance to be of one mode.
    """
    least_seen = 0.3  # least size of a point's functions over their median, for its sign to be seen
    if channels.size < FEWEST_POINTS or frf.input.node.size == 1:
        return ()
    signs: dict[tuple[int, int], list[float]] = {}
    fitting: set[int] = set()
    for peak in peaks(frf, channels, prominence):
        value = frf.value[channels, :, peak.line]
        value = value / np.linalg.norm(value, axis=0)
        size = np.linalg.norm(value, axis=1)
        seen = np.flatnonzero(size > least_seen * np.median(size))
        row = value[seen] / size[seen, None]
        proportion = np.linalg.svd(row, full_matrices=False)[2][0].conj()
        part = row * proportion
        whole = np.abs(part.sum(axis=1)) ** 2
        if np.mean(whole > fits) < most:
            continue
        turned = np.abs(part.sum(axis=1, keepdims=True) - 2.0 * part) ** 2
        fitting |= {int(channels[k]) for k in seen[whole > fits]}
        for k in np.flatnonzero((whole < contradicts) & (turned.max(axis=1) > fits)):
            which = int(channels[seen[k]]), int(turned[k].argmax())
            signs.setdefault(which, []).append(float(peak.frequency))
    return tuple(
        TurnedFunction(output=output, input=force, resonances=tuple(place))
        for (output, force), place in signs.items()
        if output not in fitting and len(place) >= FEWEST_RESONANCES
    )


FaultKind = Literal["sign", "scale", "swapped", "unexplained"]
MIN_CHANNELS = 8
"""Fewer channels in one direction do not tell a smooth shape from a rough one."""
_AGREEMENT = 0.9
"""Channels with one injected fault agreed with their neighbours to 0.998 once it was undone; where resonances
shift from run to run, which makes shapes that nobody has, the likeliest fault left less than 0.8."""


@dataclass(frozen=True, kw_only=True)
class Contradiction:
    """A fault whose undoing makes the shapes smooth.

    Attributes
    ----------
    kind : {"sign", "scale", "swapped", "unexplained"}
        What is wrong; "unexplained" where undoing it helps, but leaves the channel unlike its neighbours.
    channel : tuple of int
        Positions of the outputs; two for "swapped", all channels of a run for a run out of scale, and for "sign" all
        that are turned together, such as those of the runs in which the force was.
    factor : float
        What the channels have to be multiplied by; 1 for "swapped".
    gain : float
        Rise of the log-likelihood by undoing the fault.
    agreement : float
        Correlation of the corrected channel with what its neighbours predict, over the shapes.
    """

    kind: FaultKind
    channel: tuple[int, ...]
    factor: float
    gain: float
    agreement: float


@dataclass(frozen=True, eq=False, kw_only=True)
class _Fit:
    """Covariance of the best length and noise: its inverse and log-likelihood."""

    inverse: Reals
    value: float


def contradictions(frf: FRF, geometry: Geometry, channels: Integers, threshold: float) -> tuple[Contradiction, ...]:
    """Return the faults of channels, the clearest first, each found with the earlier ones left out.

    Parameters
    ----------
    frf : FRF
        Finite functions; the first input is used.
    geometry : Geometry
        Coordinates of the points.
    channels : (n,) int
        Positions of the outputs to use; those without coordinates are passed over.
    threshold : float
        Rise of the log-likelihood from which a fault is believed.
    """
    known = np.array([c for c in channels if frf.output.node[c] in geometry.node], dtype=np.int64)
    faults: list[Contradiction] = []
    while known.size >= MIN_CHANNELS and len(faults) < 4:
        best = _clearest(frf, geometry, known)
        if best is None or best.gain < threshold:
            break
        if best.agreement < _AGREEMENT:
            faults.append(replace(best, kind="unexplained"))
            break
        faults.append(best)
        known = known[~np.isin(known, best.channel)]
    return tuple(faults)


def undetectable_signs(frf: FRF, geometry: Geometry, channels: Integers, threshold: float) -> Integers:
    """Return the channels whose sign the others do not tell: turning one would not be believed.

    Parameters are those of `contradictions`. Channels without coordinates are among them.
    """
    known = np.array([c for c in channels if frf.output.node[c] in geometry.node], dtype=np.int64)
    if known.size < MIN_CHANNELS:
        return channels
    field = shape_space(frf.value[known, 0])
    fit = _best(_covariances(frf, geometry, known), field)
    coupling = fit.inverse * (field @ field.T)
    total, cross = coupling.sum(), coupling.sum(axis=1) - np.diag(coupling)
    loss = 0.5 * field.size * np.log(np.maximum(total - 4 * cross, 1e-300) / total)
    return np.concatenate([np.setdiff1d(channels, known), known[loss < threshold]])


def _clearest(frf: FRF, geometry: Geometry, channels: Integers) -> Contradiction | None:
    """Return the fault whose undoing raises the likelihood most, length and noise being fitted anew."""
    field = shape_space(frf.value[channels, 0])
    covariances = list(_covariances(frf, geometry, channels))
    null = _best(covariances, field)
    run, gram = frf.run[channels], field @ field.T
    together = _turned_together(covariances, gram, run)
    best: Contradiction | None = None
    for kind, members, factor in _hypotheses(null, gram, field.shape[1], run) + together:
        corrected = _undone(field, kind, members, factor)
        jacobian = field.shape[1] * len(members) * np.log(abs(factor))
        fit = _best(covariances, corrected)
        gain = fit.value + jacobian - null.value
        if best is None or gain > best.gain:
            agreement = _agreement(fit, corrected, members)
            if (kind, members, factor) in together and agreement < _AGREEMENT:
                continue  # so many signs make any shapes somewhat smoother
            best = Contradiction(
                kind=kind,
                channel=tuple(int(channels[m]) for m in members),
                factor=factor,
                gain=float(gain),
                agreement=agreement,
            )
    return best


def _turned_together(
    covariances: list[tuple[Reals, Reals]], gram: Reals, run: Integers
) -> list[tuple[FaultKind, tuple[int, ...], float]]:
    """Return channels, several and at most half, with whose signs turned the shapes are smoothest.

    For each covariance the signs ``s`` are those of the least ``s' (inverse * gram) s`` that turning one channel or one
    run more does not lessen, from the signs as they are and from those of its lowest eigenvector.
    """
    # Noises beside which signs are sought: several channels that are turned make the likeliest noise of all too
    # large.
    sign_noises = (1e-4, 1e-2, 1e-1)
    runs = (run == np.unique(run)[:, None]).astype(float)
    faults: dict[tuple[int, ...], tuple[FaultKind, tuple[int, ...], float]] = {}
    for values, vectors in covariances:
        for noise in sign_noises:
            coupling = ((vectors / (np.maximum(values, 0.0) + noise)) @ vectors.T) * gram
            lowest = np.linalg.eigh(coupling)[1][:, 0]
            for start in (np.ones(run.size), np.where(lowest < 0.0, -1.0, 1.0)):
                sign = _descended(coupling, start, runs)
                turned = tuple(np.flatnonzero(sign * np.sign(sign.sum() or sign[0]) < 0.0).tolist())
                if len(turned) > 1:
                    faults[turned] = ("sign", turned, -1.0)
    return list(faults.values())


def _descended(coupling: Reals, sign: Reals, runs: Reals) -> Reals:
    """Return signs, (n,), from which no channel's and no run's turning lessens the quadratic form of `coupling`."""
    moves = np.vstack([np.eye(sign.size), runs])
    while True:
        weighed = coupling * np.outer(sign, sign)
        inside = np.sum((moves @ weighed) * moves, axis=1)
        change = inside - moves @ weighed.sum(axis=1)  # a quarter of it
        best = int(np.argmin(change))
        if change[best] > -1e-9 * np.trace(weighed):
            return sign
        sign = np.where(moves[best] > 0.0, -sign, sign)


def _agreement(fit: _Fit, field: Reals, members: tuple[int, ...]) -> float:
    """Return the least correlation of some channels with their predictions from all others."""
    correlation = []
    for i in members:
        predicted = field[i] - fit.inverse[i] @ field / fit.inverse[i, i]
        size = np.linalg.norm(predicted) * np.linalg.norm(field[i])
        correlation.append(float(predicted @ field[i] / size) if size > 0 else 0.0)
    return min(correlation)


def shape_space(value: Complexes) -> Reals:
    """Return the shapes that the functions are made of, (n_output, n_shape), columns of like size.

    Channels are normalised before the singular value decomposition, so that one of the wrong scale does not
    make a shape of its own, and get their size back afterwards.
    """
    products = inner_products(value).real  # those of real and imaginary parts beside each other
    size = np.sqrt(np.diag(products))[:, None]
    size = np.where(size > 0, size, 1.0)
    products = products / (size * size.T)
    power, vectors = np.linalg.eigh(products)
    count = min(len(value), 2 * value.shape[1])
    left, singular = vectors[:, ::-1], np.sqrt(np.maximum(power[::-1], 0.0))[:count]
    floor = max(3 * np.median(singular), 0.02 * singular[0])
    n_shape = int(np.clip(np.count_nonzero(singular > floor), 1, max(1, len(value) // 3)))
    shapes = left[:, :n_shape] * size
    middle = np.median(np.abs(shapes), axis=0)
    return np.asarray(shapes / np.where(middle > 0, middle, np.abs(shapes).max(axis=0)))


def _covariances(frf: FRF, geometry: Geometry, channels: Integers) -> list[tuple[Reals, Reals]]:
    """Return eigenvalues and vectors of the covariance for each length; noise only shifts eigenvalues."""
    trend_size = 10.0
    lengths = np.geomspace(0.15, 2.0, 7)
    order = {int(n): i for i, n in enumerate(geometry.node)}
    position = geometry.coordinate[[order[int(n)] for n in frf.output.node[channels]]]
    position = position - position.mean(axis=0)
    size = np.linalg.norm(position, axis=1).max()
    position = position / (size if size > 0 else 1.0)
    direction = frf.output.direction[channels]
    alike = direction @ direction.T
    square = ((position[:, None] - position[None]) ** 2).sum(axis=2)
    trend = trend_size * (1.0 + position @ position.T)
    return [np.linalg.eigh(alike * (np.exp(-square / (2 * length**2)) + trend)) for length in lengths]


def _best(covariances: list[tuple[Reals, Reals]], field: Reals) -> _Fit:
    """Return the likeliest covariance, its variance being profiled out."""
    noises = np.geomspace(1e-6, 3e-1, 12)
    n, r = field.shape
    best = (-np.inf, 0, 0.0)
    for k, (values, vectors) in enumerate(covariances):
        power = ((vectors.T @ field) ** 2).sum(axis=1)
        spectrum = np.maximum(values, 0.0)[:, None] + noises
        quadratic = (power[:, None] / spectrum).sum(axis=0)
        value = -0.5 * (n * r * np.log(quadratic / (n * r)) + r * np.log(spectrum).sum(axis=0))
        i = int(np.argmax(value))
        if value[i] > best[0]:
            best = (float(value[i]), k, float(noises[i]))
    values, vectors = covariances[best[1]]
    return _Fit(inverse=(vectors / (np.maximum(values, 0.0) + best[2])) @ vectors.T, value=best[0])


def _hypotheses(fit: _Fit, gram: Reals, r: int, run: Integers) -> list[tuple[FaultKind, tuple[int, ...], float]]:
    """Return the most promising faults of each kind, judged with the covariance of the data as they are."""
    n = len(gram)
    coupling = fit.inverse * gram
    total = coupling.sum()
    diagonal = np.diag(coupling)
    cross = coupling.sum(axis=1) - diagonal
    hypotheses: list[tuple[FaultKind, tuple[int, ...], float]]
    hypotheses = [("sign", (int(i),), -1.0) for i in np.argsort(total - 4 * cross)[:4]]
    scale = []
    groups: list[tuple[int, ...]] = [(i,) for i in range(n)]
    groups += [tuple(np.flatnonzero(run == k).tolist()) for k in np.unique(run) if 1 < np.sum(run == k) < n / 2]
    for members in groups:
        inside = coupling[np.ix_(members, members)].sum()
        across = coupling[list(members)].sum() - inside
        factor = _likeliest_factor(total, inside, across, n * r, r * len(members))
        rest = total + (factor**2 - 1) * inside + 2 * (factor - 1) * across
        scale.append((n * r * np.log(rest) - 2 * r * len(members) * np.log(factor), members, factor))
    hypotheses += [("scale", members, factor) for _, members, factor in sorted(scale)[:4]]
    swaps = []
    for i in range(n):
        for j in range(i + 1, n):
            permuted = np.arange(n)
            permuted[[i, j]] = j, i
            pair, turned = np.array([i, j]), np.array([j, i])
            old, new = coupling[pair].sum(), (fit.inverse[pair] * gram[np.ix_(turned, permuted)]).sum()
            inside_old = coupling[np.ix_(pair, pair)].sum()
            inside_new = (fit.inverse[np.ix_(pair, pair)] * gram[np.ix_(turned, turned)]).sum()
            swaps.append((2 * (new - old) - (inside_new - inside_old), (i, j)))
    return hypotheses + [("swapped", pair, 1.0) for _, pair in sorted(swaps)[:8]]


def _likeliest_factor(total: float, inside: float, across: float, nr: int, weight: int) -> float:
    """Return the factor t > 0 on some channels that maximises ``weight log t - nr/2 log(quadratic(t))``."""
    rest = total - inside - 2 * across
    # derivative zero: (nr - weight) inside t^2 + (nr - 2 weight) across t - weight rest = 0
    a, b, c = (nr - weight) * inside, (nr - 2 * weight) * across, -weight * rest
    return float((-b + np.sqrt(max(b**2 - 4 * a * c, 0.0))) / (2 * a)) if a > 0 and c < 0 else 1.0


def _undone(field: Reals, kind: FaultKind, members: tuple[int, ...], factor: float) -> Reals:
    corrected = field.copy()
    if kind == "swapped":
        corrected[list(members)] = field[list(members[::-1])]
    else:
        corrected[list(members)] *= factor
    return corrected
