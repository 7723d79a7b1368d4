"""Matrices of other programs: read, refused in words, reduced."""

import contextlib
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as sla

import model
from ema import CampaignError
from model.matrices.labelled import placed
from model.matrices.readers import read_matrix
from model.matrices.reduced import points_on
from model.matrices.rows import read_nodes
from model.matrices.text import draft_structure
from model.solvers.eigen import CholeskyFactor, NotPositiveError
from updating.commands.new import new_command

EXAMPLE = Path(__file__).parents[2] / "data/matrices_example"
N, SPRING, MASS = 6, 2.0e3, 0.5  # a chain of 6 masses along x, N/m and kg, held at its first end
K = SPRING * (2.0 * np.eye(N) - np.eye(N, k=1) - np.eye(N, k=-1))
K[-1, -1] = SPRING
M = MASS * np.eye(N)
CHAIN = np.sqrt(SPRING / MASS) / np.pi * np.sin((2 * np.arange(N) + 1) * np.pi / (4 * N + 2))  # Hz, closed form
NODE = 10 + np.arange(N)

HEAD = 'name = "chain"\n[matrices]\nunits = "m-kg-s"\nstiffness = "k.npz"\nmass = "m.npz"\ndofs = "dofs.csv"\n'
TAIL = "[reduction]\nband_Hz = 100\n"


def table(node=NODE, dof=None):
    dof = np.ones(len(node), int) if dof is None else dof
    return "node,dof,x,y,z\n" + "".join(f"{n},{d},{n / 10},0,0\n" for n, d in zip(node, dof, strict=True))


def write(folder, k=K, m=M, head=HEAD, body="", labels=None):
    for name, matrix in (("k", k), ("m", m)):
        np.savez(folder / f"{name}.npz", matrix)
    (folder / "dofs.csv").write_text(labels or table())
    (folder / "chain.toml").write_text(head + body + TAIL)
    return folder / "chain.toml"


def frequencies(path, theta=None):
    return model.reduce_matrices(model.read_matrices(path)).solve(theta)[0]


def test_a_chain_has_its_closed_form(tmp_path):
    assert frequencies(write(tmp_path)) == pytest.approx(CHAIN, rel=1e-10)


def triangle(matrix, lower=True):
    part = sp.coo_matrix(np.tril(matrix) if lower else np.triu(matrix))
    return zip(part.row, part.col, part.data, strict=True)


def as_text(kind, matrix, name):
    """A matrix as a program writes it."""
    if kind == "calculix":
        return "".join(f"{i + 1} {j + 1} {v:.13e}\n" for i, j, v in triangle(matrix, lower=False))
    if kind == "abaqus":
        return "".join(f"{NODE[i]},1, {NODE[j]},1,  {v:.15e}\n" for i, j, v in triangle(matrix))
    if kind == "market":
        head = f"%%MatrixMarket matrix coordinate real symmetric\n{N} {N} {np.count_nonzero(np.tril(matrix))}\n"
        return head + "".join(f"{i + 1} {j + 1} {v:.15e}\n" for i, j, v in triangle(matrix))
    lines = [f"DMIG    {name:8s}       0       6       2       0{'':16s}{N:8d}"]
    for j in range(N):
        lines.append(f"DMIG*   {name:16s}{NODE[j]:16d}{1:16d}")
        lines += [
            f"*       {NODE[i]:16d}{1:16d}{matrix[i, j]:16.9E}".replace("E", "D") for i in range(j, N) if matrix[i, j]
        ]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("kind", "file"),
    [("calculix", "k.sti"), ("abaqus", "k_STIF1.mtx"), ("market", "k.mtx"), ("market", "k.mmf"), ("nastran", "k.pch")],
)
def test_each_program_s_text_is_read(tmp_path, kind, file):
    (tmp_path / file).write_text(as_text(kind, K, "KAAX"))
    (tmp_path / "k.dof").write_text("".join(f"{n}.1\n" for n in NODE))
    entries = read_matrix(file, tmp_path, "K", tmp_path / "k.dof")
    assert placed(entries, NODE, np.ones(N, int), "it").toarray() == pytest.approx(K, rel=1e-9)


def test_labels_of_ansys_are_read(tmp_path):
    text = "  Matrix Eqn     Node      DOF\n" + "".join(f"{i + 1:12d}{n:9d}  UX\n" for i, n in enumerate(NODE))
    path = write(tmp_path, head=HEAD.replace("dofs.csv", "k.mapping") + 'nodes = "dofs.csv"\n')
    (tmp_path / "k.mapping").write_text(text)
    assert frequencies(path) == pytest.approx(CHAIN)


def test_npz_of_scipy_and_matlab_files_are_read(tmp_path):
    sp.save_npz(tmp_path / "sparse.npz", sp.csc_matrix(K))
    scipy.io.savemat(tmp_path / "all.mat", {"K1": K, "M0": sp.csc_matrix(M)})
    head = HEAD.replace('mass = "m.npz"', 'mass = "all.mat#M0"')
    for stiffness in ("sparse.npz", "all.mat#K1"):
        path = write(tmp_path, head=head.replace("k.npz", stiffness))
        assert frequencies(path) == pytest.approx(CHAIN)


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("a.inp", "*NODE, NSET=ALL\n1, 0, 0, 0\n2, 1.5, 2.5, -3\n*NSET, NSET=Two\n2,\n"),
        ("a.bdf", "GRID           1              0.      0.      0.\n"
            "GRID*                  2                             1.5             2.5\n*                    -3.\n"),
        ("b.bdf", "GRID,1,,0.,0.,0.\nGRID,2,,1.5,2.5,-.3+1\n"),
        ("a.cdb", "NBLOCK,6,SOLID,2,2\n(3i9,6e21.13e3)\n        1        0        0\n        2        0        0"
            + "".join(f"{v:21.13E}" for v in (1.5, 2.5, -3.0)) + "\nN,R5.3,LOC,       -1,\n"),
        ("a.csv", "node,x,y,z\n2,1.5,2.5,-3\n1,0,0,0\n"),
    ],
)  # fmt: skip
def test_nodes_are_read(tmp_path, file, text):
    (tmp_path / file).write_text(text)
    nodes = read_nodes(tmp_path / file)
    assert nodes.number.tolist() == [1, 2]
    assert nodes.location == pytest.approx(np.array([[0, 0, 0], [1.5, 2.5, -3.0]]))
    if file == "a.inp":
        assert nodes.sets["TWO"].tolist() == [2]


def lagrange():
    k = np.zeros((N + 1, N + 1))
    k[:N, :N] = K
    k[-1, 0] = k[0, -1] = SPRING
    return k


def changed(matrix, row, column, value):
    found = matrix.copy()
    found[row, column] = value
    return found


SEVEN = table([*NODE, 99])
REFUSED = {
    "asymmetric": ({"k": changed(K, 0, 1, -0.9 * SPRING)}, "not symmetric.*node 10, x.*node 11, x"),
    "no mass": ({"m": 0.0 * M}, "density"),
    "Lagrange row": ({"k": lagrange(), "m": np.diag([*np.diag(M), 0]), "labels": SEVEN}, "node 99, x.*Lagrange"),
    "negative": ({"k": changed(K, 2, 2, -1.0)}, "node 12, x has a stiffness of -1"),
    "no number": ({"k": changed(K, 2, 2, np.nan)}, "node 12, x.*nan"),
    "twice the label": ({"labels": table([10, *NODE[1:-1], 10])}, "node 10, x is there 2 times.*cyclic"),
    "pressure": ({"labels": table(NODE, [1, 1, 8, 1, 1, 1])}, "row 3 is node 12, degree of freedom 8"),
    "fewer labels": ({"labels": table(NODE[:-1])}, "6.*5.*do not match"),
    "units": (
        {"head": HEAD.replace("m-kg-s", "mm-t-s") + "total_mass_kg = 3.0\n"},
        "weigh 3000 kg.*m-kg-s.*would be right",
    ),
    "unknown units": ({"head": HEAD.replace("m-kg-s", "mm-N")}, "mm-t-s"),
    "grounded": ({"head": HEAD + "rigid_modes = 1\n"}, "0 modes are near 0.*x .* Hz"),
    "indefinite": ({"k": K - 1.5 * SPRING * (np.eye(N, k=1) + np.eye(N, k=-1))}, "negative along the lowest mode"),
    "unknown key": ({"body": '[[term]]\nname = "a"\nstifness = "k.npz"\n'}, "stifness"),
    "no such file": ({"head": HEAD.replace("k.npz", "q.npz")}, "q.npz.*cannot be read"),
    "unknown suffix": ({"head": HEAD.replace("k.npz", "k.op2")}, "the suffix says no program"),
    "empty group": ({"body": '[[group]]\nname = "g"\nbox_mm = [[0, 1], [0, 1], [0, 1]]\n'}, "holds no node"),
    "unknown node": ({"body": '[[group]]\nname = "g"\nnodes = [7]\n'}, "there is no node 7"),
    "unknown group": ({"body": '[[term]]\nname = "a"\ngroup = "g"\nspring_N_m = 1\n'}, "no group 'g'"),
    "held before": (
        {"body": '[[group]]\nname = "g"\nnodes = [10]\n[[support]]\ngroup = "g"\n'
            'directions = ["y"]\nstate = "released"\n'},
        "node 10, y is not in the matrices",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_right_is_refused_in_words(tmp_path, case):
    given, says = REFUSED[case]
    with pytest.raises(model.MatricesError, match=f"(?s){says}"):
        frequencies(write(tmp_path, **given))


def test_a_row_of_another_matrix_is_refused(tmp_path):
    (tmp_path / "k.mtx").write_text("1,1,1,1,5.\n")
    entries = read_matrix("k.mtx", tmp_path, "K", None)
    with pytest.raises(model.MatricesError, match="node 1, x is not among the rows of the mass"):
        placed(entries, NODE, np.ones(N, int), "the mass")


def test_an_entry_that_is_there_twice_is_refused(tmp_path):
    (tmp_path / "k.mtx").write_text("1,1,1,1,5.\n2,1,2,1,5.\n1,1,1,1,5.\n")
    with pytest.raises(model.MatricesError, match=r"node 1, x; node 1, x\) is there twice"):
        read_matrix("k.mtx", tmp_path, "K", None)


@pytest.mark.parametrize("text", ["1,1,1,1,5.\n1,1,2,1\n", "1,1,1,1,5.\n1,1,2,1,five\n", ""])
def test_a_damaged_line_is_named(tmp_path, text):
    (tmp_path / "k.mtx").write_text(text)
    with pytest.raises(model.MatricesError, match=r"k\.mtx: .*(must be: node, dof|empty)"):
        read_matrix("k.mtx", tmp_path, "K", None)


@pytest.mark.parametrize(
    ("kind", "file"), [("calculix", "k.sti"), ("abaqus", "k.mtx"), ("market", "k.mmf"), ("nastran", "k.pch")]
)
def test_a_file_that_is_cut_off_amidst_a_number_is_named(tmp_path, kind, file):
    """The last number then lacks digits or its exponent, and would be read as another one."""
    text = as_text(kind, K, "KAAX").rstrip()
    (tmp_path / "k.dof").write_text("".join(f"{n}.1\n" for n in NODE))
    for lost in (0, 2, 9):
        (tmp_path / file).write_text(text[: len(text) - lost])
        with pytest.raises(model.MatricesError, match="it is cut off"):
            read_matrix(file, tmp_path, "K", tmp_path / "k.dof")


def test_a_file_that_is_cut_off_between_lines_is_asked_about(tmp_path):
    head = HEAD.replace("k.npz", "k.mtx")
    lines = as_text("abaqus", K, "").splitlines(keepends=True)
    for n in (len(lines) // 2, len(lines) - 1):
        (tmp_path / "k.mtx").write_text("".join(lines[:n]))
        with pytest.raises(model.MatricesError, match="cut off"):
            model.read_matrices(write(tmp_path, head=head))


@pytest.mark.parametrize("name", ["sparse.npz", "dense.npz", "k.mat"])
def test_a_damaged_file_of_arrays_is_refused_or_read(tmp_path, name):
    """Zip, its compression and scipy raise what they like, and conversions of wrong sparse indices crashed Python."""
    sp.save_npz(tmp_path / "sparse.npz", sp.csr_matrix(K))
    np.savez(tmp_path / "dense.npz", K=K)
    scipy.io.savemat(tmp_path / "k.mat", {"K": sp.csc_matrix(K)})
    (tmp_path / "dofs.csv").write_text(table())
    whole, rng = (tmp_path / name).read_bytes(), np.random.default_rng(0)
    for number in range(60):
        content = bytearray(whole[: rng.integers(1, len(whole))] if number % 2 else whole)
        content[rng.integers(len(content))] = rng.integers(256)
        (tmp_path / name).write_bytes(bytes(content))
        with contextlib.suppress(model.MatricesError):
            read_matrix(name, tmp_path, "K", tmp_path / "dofs.csv")


def test_exponents_of_fortran_are_read(tmp_path):
    (tmp_path / "k.mtx").write_text("1,1, 1,1, 5.0D+03\n2,1,2,1,1.5d-1\n")
    assert read_matrix("k.mtx", tmp_path, "K", None).matrix.data.tolist() == [5000.0, 0.15]


def test_a_complex_matrix_of_nastran_is_refused(tmp_path):
    (tmp_path / "k.pch").write_text(
        "DMIG    KAAX           0       6       4       0\nDMIG*   KAAX                           1               1\n"
        "*                      1               1  5.0000000D+03  1.0000000D+02\n"
    )
    with pytest.raises(model.MatricesError, match="matrix KAAX is complex; write it without structural damping"):
        read_matrix("k.pch", tmp_path, "K", None)


def test_a_table_of_rows_with_semicolons_and_decimal_commas(tmp_path):
    labels = table().replace(".", "|").replace(",", ";").replace("|", ",")
    path = write(tmp_path, labels=labels)
    assert frequencies(path) == pytest.approx(CHAIN, rel=1e-10)
    assert model.read_matrices(path).location[:, 0] == pytest.approx(NODE / 10)


def test_labels_of_calculix_beside_compressed_matrices(tmp_path):
    for name in ("plate.sti.gz", "plate.dof"):
        shutil.copy(EXAMPLE / name, tmp_path)
    assert read_matrix("plate.sti.gz", tmp_path, "K", None).node.size > 600


def test_units_that_make_no_structure_are_asked_about(tmp_path):
    for name in ("plate.sti.gz", "plate.mas.gz", "plate.dof", "plate.inp"):
        shutil.copy(EXAMPLE / name, tmp_path)
    head = 'name = "p"\n[matrices]\nunits = "{}"\nstiffness = "plate.sti.gz"\nmass = "plate.mas.gz"\n'
    head += 'nodes = "plate.inp"\n'

    def notes(units):
        (tmp_path / "s.toml").write_text(head.format(units) + TAIL)
        return " ".join(model.read_matrices(tmp_path / "s.toml").notes)

    assert "are the units of all files m-kg-s?" in notes("m-kg-s")
    assert "are the units" not in notes("mm-t-s")


@pytest.mark.parametrize(("units", "asked"), [("mm-t-s", False), ("m-kg-s", True)])
def test_units_of_what_has_no_volume_are_asked_about(tmp_path, units, asked):
    labels = "node,dof,x,y,z\n" + "".join(f"{n},1,{150 * i},{60 * (i % 2)},0\n" for i, n in enumerate(NODE))
    structure = model.read_matrices(write(tmp_path, m=M / 1e3, head=HEAD.replace("m-kg-s", units), labels=labels))
    assert ("are the units" in structure.notes[-1]) == asked


def test_rows_in_another_order_than_their_table_are_asked_about(tmp_path):
    light = np.diag(np.repeat([1.0, 0.1], 3))  # a node of 1 kg and one of 0.1 kg
    for dof, right in ((np.tile([1, 2, 3], 2), True), (np.repeat([1, 2, 3], 2), False)):
        path = write(tmp_path, np.eye(6), light, labels=table(np.repeat([10, 11], 3) if right else [10, 11] * 3, dof))
        assert ("not weigh the same" in " ".join(model.read_matrices(path).notes)) != right


def test_a_structure_is_weighed_with_what_is_held(tmp_path):
    body = '[[group]]\nname = "g"\nnodes = [10, 11]\n[[support]]\ngroup = "g"\ndirections = ["x"]\nstate = "held"\n'
    structure = model.read_matrices(write(tmp_path, head=HEAD + "total_mass_kg = 3.0\n", body=body))
    assert structure.node.size == N - 2
    assert "total mass 3 kg" in structure.notes[-1]


@pytest.mark.parametrize(
    ("file", "text", "says"),
    [
        ("a.inp", "*PART, NAME=A\n*NODE\n1,0,0,0\n*INSTANCE, NAME=B, PART=A\n1.,0.,0.\n", "line 4: .INSTANCE moves"),
        ("a.inp", "*SYSTEM\n1,0,0\n*NODE\n1,0,0,0\n", "line 1: .SYSTEM moves nodes"),
        ("a.bdf", "GRID,1,7,0.,0.,0.\n", "grid 1 has a coordinate system"),
        (
            "a.cdb",
            "NBLOCK,6,SOLID,1,1\n(1i9,6e9.1e1)\n        1" + "  0.0E+00" * 3 + "  9.0E+01\n",
            "node 1 has turned",
        ),
    ],
)
def test_local_directions_are_refused(tmp_path, file, text, says):
    (tmp_path / file).write_text(text)
    with pytest.raises(model.MatricesError, match=says):
        read_nodes(tmp_path / file)


def test_an_internal_node_is_named_before_its_place_is_asked_for(tmp_path):
    (tmp_path / "k.mtx").write_text(as_text("abaqus", K, "") + "-5,1,-5,1,2000.\n")
    path = write(tmp_path, head=HEAD.replace("k.npz", "k.mtx"))
    with pytest.raises(model.MatricesError, match="row 1 is node -5, x, which is no displacement"):
        model.read_matrices(path)


@pytest.mark.parametrize("name", ["all.npz", "all.mat"])
def test_a_folder_with_both_matrices_in_one_file_gets_a_first_structure_file(tmp_path, name):
    arrays = {"freq": np.arange(3.0), "Kff": K, "Mff": M}
    np.savez(tmp_path / name, **arrays) if name.endswith("npz") else scipy.io.savemat(tmp_path / name, arrays)
    (tmp_path / "dofs.csv").write_text(table())
    text = draft_structure(tmp_path)
    assert f'stiffness = "{name}#Kff"' in text
    assert f'mass = "{name}#Mff"' in text
    assert 'dofs = "dofs.csv"' in text


def test_a_folder_with_a_model_alone_is_no_fault(tmp_path, capsys):
    write(tmp_path).unlink()
    new_command(tmp_path)
    assert "structure.toml; fill in units" in " ".join(capsys.readouterr().out.split())
    with pytest.raises(CampaignError, match="no file in it looks like a measurement"):
        new_command(tmp_path)


def test_a_triangle_and_both_give_the_same(tmp_path):
    both = "".join(f"{NODE[i]},1,{NODE[j]},1,{K[i, j]!r}\n" for i, j in zip(*K.nonzero(), strict=True))
    (tmp_path / "both.mtx").write_text(both.replace("np.float64(", "").replace(")", ""))
    (tmp_path / "one.mtx").write_text(as_text("abaqus", K, ""))
    both, one = (read_matrix(f"{name}.mtx", tmp_path, "K", None).matrix for name in ("both", "one"))
    assert abs(both - one).max() == 0.0


def test_abaqus_holds_by_an_enormous_stiffness(tmp_path):
    (tmp_path / "k.mtx").write_text(as_text("abaqus", K, "") + "9,1,9,1,1e36\n9,1,10,1,-2000.\n")
    (tmp_path / "m.mtx").write_text(as_text("abaqus", M, "") + "9,1,9,1,0.5\n")
    head = HEAD.replace("npz", "mtx").replace('dofs = "dofs.csv"', 'nodes = "dofs.csv"')
    path = write(tmp_path, head=head, labels=table([9, *NODE]))
    assert frequencies(path) == pytest.approx(CHAIN)
    assert "1 rows are held" in model.read_matrices(path).notes[0]


def test_rows_without_mass_follow_the_others(tmp_path):
    m = M.copy()
    m[2, 2] = 0.0
    kept = [0, 1, 3, 4, 5]
    condensed = K[np.ix_(kept, kept)] - np.outer(K[kept, 2], K[2, kept]) / K[2, 2]
    exact = np.sqrt(la.eigh(condensed, m[np.ix_(kept, kept)], eigvals_only=True)) / (2 * np.pi)
    path = write(tmp_path, m=m)
    assert frequencies(path)[:5] == pytest.approx(exact)
    assert "1 rows have no mass" in model.read_matrices(path).notes[0]


def test_beams_whose_rotations_have_no_mass(tmp_path):
    """What rounding leaves without mass once all that moves is found would spoil the modes."""
    n = 63
    side = 1.0 / n
    beam = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]]) / side**3
    beam *= np.outer([1, side, 1, side], [1, side, 1, side])
    k = np.zeros((2 * n + 2, 2 * n + 2))
    for i in range(0, 2 * n, 2):
        k[i : i + 4, i : i + 4] += beam
    k, m = k[2:, 2:], np.diag(np.tile([side, 0.0], n))
    exact = np.sqrt(1.0 / la.eigh(m, k, eigvals_only=True)[::-1][:5]) / (2 * np.pi)
    labels = "node,dof,x,y,z\n" + "".join(f"{i + 1},{d},{i * side},0,0\n" for i in range(n) for d in ("z", "ry"))
    assert frequencies(write(tmp_path, k, m, labels=labels))[:5] == pytest.approx(exact, rel=1e-8)


def test_units_become_si(tmp_path):
    """In mm, t and s a stiffness is in N/mm, and one against rotation in N mm."""
    k, m = np.diag([3.0, 5.0]), np.diag([2e-3, 7e-3])
    labels = "node,dof,x,y,z\n1,z,0,0,0\n1,rx,0,0,0\n"
    structure = model.read_matrices(write(tmp_path, k, m, HEAD.replace("m-kg-s", "mm-t-s"), labels=labels))
    assert structure.matrix("K", {}).toarray() == pytest.approx(np.diag([3e3, 5e-3]))
    assert structure.matrix("M", {}).toarray() == pytest.approx(np.diag([2.0, 7e-6]))


def test_terms_are_taken_out_of_what_holds_them(tmp_path):
    part = np.zeros((N, N))
    part[:2, :2] = SPRING * np.array([[1, -1], [-1, 1]])
    np.savez(tmp_path / "part.npz", part)
    np.savez(tmp_path / "doubled.npz", K + part)
    stated = '[[term]]\nname = "a"\nstiffness = "part.npz"\n'
    other = '[[term]]\nname = "a"\nstiffness = "doubled.npz"\nmultiplied_by = 2.0\n'
    for body in (stated, other):
        structure = model.read_matrices(write(tmp_path, body=body))
        assert structure.matrix("K", {"a": 1.0}).toarray() == pytest.approx(K)
        assert structure.matrix("K", {"a": 1.5}).toarray() == pytest.approx(K + 0.5 * part)
        reduced = model.reduce_matrices(structure)
        exact = np.sqrt(la.eigh(K + 0.5 * part, M, eigvals_only=True)) / (2 * np.pi)
        assert reduced.solve({"a": 1.5})[0] == pytest.approx(exact)
        assert reduced.derivative("K", reduced.theta, "a") == pytest.approx(
            reduced.matrix("K", {"a": 2.0}) - reduced.matrix("K", {"a": 1.0})
        )


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ('stiffness = "twice.npz"\n', "take more stiffness out of node 15, x than the whole matrix has"),
        ('mass = "k.npz"\n', "take more mass out of node 10, x"),
        ('stiffness = "k.npz"\nmultiplied_by = 2.0\n', "k.npz is the whole matrix as it is"),
    ],
)
def test_a_term_that_is_no_part_of_the_whole_is_refused(tmp_path, body, says):
    part = np.zeros((N, N))
    part[-2:, -2:] = 1.5 * SPRING * np.array([[1, -1], [-1, 1]])
    np.savez(tmp_path / "twice.npz", part)
    with pytest.raises(model.MatricesError, match=says):
        model.read_matrices(write(tmp_path, body=f'[[term]]\nname = "a"\n{body}'))


def test_a_box_without_nodes_says_where_these_are(tmp_path):
    body = '[[group]]\nname = "g"\nbox_mm = [[1, 2], [-1, 1], [-1, 1]]\n'
    with pytest.raises(model.MatricesError, match="holds no node; nodes span 1000 to 1500, 0 to 0, 0 to 0 mm"):
        model.read_matrices(write(tmp_path, body=body))


def test_a_stiffness_that_is_the_sum_of_terms(tmp_path):
    head = HEAD.replace('stiffness = "k.npz"\n', "")
    structure = model.read_matrices(write(tmp_path, head=head, body='[[term]]\nname = "a"\nstiffness = "k.npz"\n'))
    assert structure.matrix("K", {"a": 2.0}).toarray() == pytest.approx(2.0 * K)


def test_springs_masses_and_supports(tmp_path):
    body = (
        '[[group]]\nname = "end"\nnodes = [14, 15]\n'
        '[[group]]\nname = "first"\nbox_mm = [[999, 1001], [-1, 1], [-1, 1]]\n'
        '[[term]]\nname = "s"\ngroup = "end"\nspring_N_m = 10\nmass_kg = 0.2\n'
        '[[support]]\ngroup = "first"\ndirections = ["x"]\nstate = "held"\n'
    )
    structure = model.read_matrices(write(tmp_path, body=body))
    share = np.diag([0, 0, 0, 0.5, 0.5])
    assert structure.matrix("K", structure.theta).toarray() == pytest.approx(K[1:, 1:] + 10 * share)
    assert structure.matrix("M", {"s": 2.0}).toarray() == pytest.approx(M[1:, 1:] + 0.4 * share)


def brick(n):
    """Stiffness-like matrix of a grid of n x n x n places with a node coupled across it, and the places."""
    place = np.stack(np.meshgrid(*3 * [np.arange(n)], indexing="ij"), axis=-1).reshape(-1, 3).astype(float)
    line = sp.diags_array([-np.ones(n - 1), 2.1 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1])
    one = sp.eye_array(n)
    matrix = sp.lil_matrix(
        sum(sp.kron(sp.kron(*p[:2]), p[2]) for p in ((line, one, one), (one, line, one), (one, one, line)))
    )
    matrix[0, -1] = matrix[-1, 0] = -0.05
    return sp.csr_matrix(matrix), place


def test_a_factor_by_nested_dissection_solves():
    matrix, place = brick(9)
    right = np.random.default_rng(1).standard_normal((place.shape[0], 3))
    found = CholeskyFactor(matrix, place).solve(right)
    assert matrix @ found == pytest.approx(right, abs=1e-12)


def test_a_matrix_that_is_not_positive_is_refused():
    matrix, place = brick(5)
    matrix = matrix - sp.diags_array(3.0 * (np.arange(place.shape[0]) == 7))
    matrix = matrix - sp.diags_array(9.0 * (np.arange(place.shape[0]) == 7))
    with pytest.raises(NotPositiveError):
        CholeskyFactor(matrix, place)


@pytest.fixture(scope="module")
def example():
    structure = model.read_matrices(EXAMPLE / "structure.toml")
    return structure, model.reduce_matrices(structure)


def sparse_frequencies(structure, theta, n):
    return np.sqrt(sparse_modes(structure, theta, n)[0]) / (2 * np.pi)


def sparse_modes(structure, theta, n):
    """By ARPACK and SuperLU: the mass of elements with reduced integration is singular, which dense solvers refuse."""
    k, m = (sp.csc_matrix(structure.matrix(target, theta)) for target in ("K", "M"))
    value, vector = sla.eigsh(k, n, m, sigma=-1e5, v0=np.ones(k.shape[0]))
    return value[np.argsort(value)], vector[:, np.argsort(value)]


def test_the_example_is_reduced_as_well_as_it_says(example):
    structure, reduced = example
    assert reduced.size < structure.node.size / 8  # twelve of them for four places more than one
    for theta, limit in (({}, 1e-7), ({"root_springs": np.e, "strip": 1.1, "tip_mass": 0.5}, 1e-4)):
        moved = {**structure.theta, **theta}
        error = reduced.solve(moved)[0][:10] / sparse_frequencies(structure, moved, 10) - 1
        assert np.abs(error).max() < limit
    for name, error in reduced.left.items():
        theta = {f.name: f.away(1.0) if f.name == name else f.nominal for f in structure.factors}
        true = reduced.solve(theta)[0][:10] / sparse_frequencies(structure, theta, 10) - 1
        assert true.max() <= 3 * error + 3e-8  # the size of what is left, not of what matters


def test_static_responses_lower_what_is_left(example):
    structure, reduced = example
    without = model.reduce_matrices(replace(structure, patches=()))
    assert reduced.size > without.size


def bending(place):
    """Displacements of second order in x and y, and of first in z, (n, 3)."""
    x, y, z = np.asarray(place).T
    return np.column_stack([z * x, 0.3 * y * y, x * x - 2.0 * x * y + z])


def test_rows_are_shapes_at_places(example):
    structure, reduced = example
    on, between = [0.24, 0.0, 0.004], [0.13, 0.07, 0.0041]
    found = points_on(structure, [1, 2], np.array([on, between]), np.array([[0, 0, 1.0]] * 2))
    assert found.distance == pytest.approx([0.0, np.hypot(0.01, 0.01)], rel=1e-4)
    shape = sparse_modes(structure, structure.theta, 3)[1][:, 0]
    tip = np.flatnonzero((structure.dof == 3) & (np.linalg.norm(structure.location - on, axis=1) < 1e-9))
    first = found.rows(reduced)[0] @ reduced.solve(n_mode=1)[1][:, 0]
    assert abs(first[0]) == pytest.approx(abs(shape[tip[0]]), rel=1e-6)
    exact = replace(reduced, basis=bending(structure.location)[np.arange(len(structure.dof)), structure.dof - 1, None])
    rows, slope = found.rows(exact)
    assert rows[:, 0] == pytest.approx(bending([on, between])[:, 2], abs=1e-5)
    assert slope[:, 0] == pytest.approx([2 * 0.24, 2 * 0.13 - 2 * 0.07], abs=1e-3)


def test_a_point_off_the_structure_is_named(example):
    with pytest.raises(model.MatricesError, match=r"point 7 is 260 mm from the nearest node.*check their unit"):
        points_on(example[0], [7], np.array([[0.5, 0.0, 0.0]]), np.array([[0, 0, 1.0]]))


def test_points_are_nodes_where_no_file_says_where_these_are(tmp_path):
    structure = model.read_matrices(write(tmp_path, labels=table().replace(",x,y,z", ",a,b,c")))
    rows = points_on(structure, NODE[:2], np.zeros((2, 3)), np.array([[1.0, 0, 0]] * 2)).rows(
        model.reduce_matrices(structure)
    )[0]
    assert rows.shape == (2, N)
    with pytest.raises(model.MatricesError, match="point 3 has no node of its number"):
        points_on(structure, [3], np.zeros((1, 3)), np.array([[1.0, 0, 0]]))


def test_a_basis_is_joined_where_factors_go_far(example):
    structure, reduced = example
    far = {"root_springs": 0.02, "strip": 1.6}
    wide = model.reduce_matrices(structure, far, beside=reduced)
    assert reduced.error(far) > 1e-5 > wide.error(far)
    for theta in ({}, far):
        one = sparse_frequencies(structure, {**structure.theta, **theta}, 10)
        assert wide.solve({**structure.theta, **theta})[0][:10] == pytest.approx(one, rel=1e-5)


@pytest.mark.skipif(shutil.which("ccx") is None, reason="needs CalculiX as ccx (apt install calculix-ccx)")
def test_frequencies_are_calculix_own(tmp_path, example):
    """Its springs are in the deck, ours are a term: the two assemble and solve apart."""
    code = (
        "import make; from pathlib import Path; "
        f"make.run(make.deck(springs=True, step='*FREQUENCY, SOLVER=ARPACK\\n10'), Path({str(tmp_path)!r}), 'own')"
    )
    subprocess.run([sys.executable, "-B", "-c", code], cwd=EXAMPLE, check=True)
    lines = (line.split() for line in (tmp_path / "own.dat").read_text().splitlines())
    one = [float(words[1]) for words in lines if len(words) == 5 and words[0].isdigit()][:10]  # (rad/s)2
    found = example[1].solve()[0][:10]
    assert found == pytest.approx(np.sqrt(one) / (2 * np.pi), rel=1e-6)


def test_punch_files_as_pyyeti_reads_them(tmp_path):
    bulk = pytest.importorskip("pyyeti.nastran.bulk")
    (tmp_path / "k.pch").write_text(as_text("nastran", K, "KAAX"))
    other = bulk.rddmig(str(tmp_path / "k.pch"))["kaax"].to_numpy()
    whole = read_matrix("k.pch", tmp_path, "K", None).matrix.toarray()
    assert whole == pytest.approx(other if np.allclose(other, other.T) else other + other.T - np.diag(np.diag(other)))
