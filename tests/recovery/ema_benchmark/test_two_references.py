"""Two modes of one frequency told apart by two forces, beside SDynPy's PolyPy; pyOMA2 takes no forces.

    pytest tests/recovery/ema_benchmark/test_two_references.py -m benchmark -s

PolyPy is given both forces and the true frequencies: the poles of its highest order nearest to them are taken, each
once, and the shapes that it fits to them. A pair counts as found if both poles are within a bandwidth
of it and the shapes span the true ones.
"""

import contextlib
import importlib.util
import io
import os
import warnings

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from tests.recovery.symmetric_structures import DAMPING, square_plate, stator_ring
from tests.recovery.test_repeated_roots import identified, subspace_mac, worst_mac

pytestmark = pytest.mark.benchmark
SETS = int(os.environ.get("PEER_SETS", "10"))
SPLITS = 0.0, 1e-4, 5e-4
ORDER = 14


def polypy(structure, frf):
    """Least subspace MAC of the pairs by PolyPy with two references, 0 where a pole is missing."""
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
        warnings.simplefilter("ignore")
        import sdynpy

        output = sdynpy.coordinate_array(np.arange(1, len(frf.value) + 1), 3)[:, None]
        forces = sdynpy.coordinate_array(np.array(structure.forces) + 1, 3)[None]
        dofs = np.stack(np.broadcast_arrays(output, forces), axis=-1)
        kind = sdynpy.data.FunctionTypes.FREQUENCY_RESPONSE_FUNCTION
        functions = sdynpy.data_array(kind, frf.frequency, np.array(frf.value), dofs)
        model = sdynpy.modal.PolyPy(functions)
        model.compute_poles(np.arange(2, ORDER + 1))
        poles = model.pole_list[0]
    poles = poles[poles["zeta"] > 0]
    true = np.sort(structure.frequency[structure.seen])
    distance = np.abs(poles["omega"][:, None] / (2.0 * np.pi) / true - 1.0)
    row, column = linear_sum_assignment(distance)
    near = distance[row, column] < 2.0 * DAMPING
    if row.size < true.size or not near.all():
        return 0.0
    one = poles[row[np.argsort(column)]]
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
        warnings.simplefilter("ignore")
        model.compute_shapes(one, real_modes=False)
    shape = model.shapes[output[:, 0]].T if hasattr(model.shapes, "coordinate") else model.shapes
    real = structure.shape[:, structure.seen][:, np.argsort(structure.frequency[structure.seen])]
    first = np.flatnonzero(np.diff(true, prepend=0.0) > 2e-3 * true)
    groups = np.split(np.arange(true.size), first[1:])
    return min(subspace_mac(real[:, g], shape[:, g]) for g in groups)


def test_pairs_of_modes(capsys):
    peer = importlib.util.find_spec("sdynpy") is not None
    rows = []
    for make in (square_plate, stator_ring):
        for split in SPLITS:
            structure = make(split)
            frfs = [structure.measured(np.random.default_rng([45, seed])) for seed in range(SETS)]
            mine = np.array([worst_mac(structure, identified(structure, frf)) for frf in frfs])
            theirs = np.array([polypy(structure, frf) for frf in frfs]) if peer else np.full(SETS, np.nan)
            rows.append((make.__name__, split, mine, theirs))
    with capsys.disabled():
        print(f"\n{SETS} sets each: pairs with a subspace MAC of 0.99, and its median")
        print("| structure | split [%] | Lamella | | PolyPy | |\n| --- | --- | --- | --- | --- | --- |")
        for name, split, mine, theirs in rows:
            cells = " | ".join(f"{np.mean(m > 0.99):.2f} | {np.median(m):.5f}" for m in (mine, theirs))
            print(f"| {name} | {100 * split:g} | {cells} |")
    assert all(np.mean(mine > 0.99) >= 0.9 for _, _, mine, _ in rows)
