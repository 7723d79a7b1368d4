"""Draw which folder imports from which, as SVG: `make house`."""

from __future__ import annotations

import ast
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Set
from html import escape
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("ema", "updating", "model")  # from left to right: `updating` imports from both
Graph = Mapping[str, Set[str]]

BOX = (190, 30)
STEP = 58  # from one folder to the next
LEFT = {"ema": 70, "updating": 410, "model": 750}
TOP = 70
STYLE = """
text { font: 13px system-ui, sans-serif; fill: #24292f; }
.head { font-weight: 600; font-size: 16px; }
.size { font-size: 11px; fill: #6e7781; }
rect { fill: #f6f8fa; stroke: #8c959f; }
path { fill: none; stroke: #0969da; stroke-width: 1.3; marker-end: url(#end); }
path.across { stroke: #bc4c00; stroke-opacity: 0.45; }
svg { background: #ffffff; }
"""


def imports(path: Path) -> Iterator[str]:
    """Yield what a module imports anywhere, as dotted names."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


def folder(module: str) -> str:
    """Return package and folder of a module; of a name that the package itself offers, the package."""
    return "/".join(module.split(".")[:2])


def folders() -> tuple[dict[str, set[str]], Counter[str]]:
    """Return the folders from which each folder imports, and how many lines each has."""
    graph: dict[str, set[str]] = {}
    lines: Counter[str] = Counter()
    for package in PACKAGES:
        for path in sorted((ROOT / package).glob("*/**/*.py")):
            name = "/".join(path.relative_to(ROOT).parts[:2])
            graph.setdefault(name, set()).update(map(folder, imports(path)))
            lines[name] += path.read_text(encoding="utf-8").count("\n")
    return {name: {t for t in targets if t in graph and t != name} for name, targets in graph.items()}, lines


def height(graph: Graph, name: str) -> int:
    """Return how many folders of its package stand below one, along the longest way."""
    within = (t for t in graph[name] if t.split("/")[0] == name.split("/")[0])
    return 1 + max((height(graph, target) for target in within), default=-1)


def direct(graph: Graph) -> dict[str, set[str]]:
    """Return the arrows that no way over other folders stands for."""
    reached: dict[str, set[str]] = {}

    def all_below(name: str) -> set[str]:
        if name not in reached:
            reached[name] = set().union(*({t} | all_below(t) for t in graph[name]))
        return reached[name]

    return {
        name: {t for t in targets if not any(t in all_below(other) for other in targets - {t})}
        for name, targets in ((name, set(targets)) for name, targets in graph.items())
    }


def drawn(graph: Graph, lines: Counter[str]) -> str:
    """Return the graph as SVG: a column for each package, what imports nothing at the top."""
    place: dict[str, tuple[float, float]] = {}
    for package in PACKAGES:
        folders = sorted((n for n in graph if n.startswith(f"{package}/")), key=lambda n: (height(graph, n), n))
        place |= {name: (LEFT[package], TOP + STEP * i) for i, name in enumerate(folders)}
    below = TOP + max(y for _, y in place.values()) + 10
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1010 {below:.0f}" width="1010">',
        f"<style>{STYLE}</style><title>Which folder imports from which</title>",
        '<defs><marker id="end" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        '<path d="M0 0L8 4L0 8z" style="fill:#57606a;stroke:none;marker-end:none"/></marker></defs>',
    ]
    parts += [
        f'<text class="head" x="{LEFT[p] + BOX[0] / 2}" y="40" text-anchor="middle">{p}/</text>' for p in PACKAGES
    ]
    for name, targets in direct(graph).items():
        parts += [arrow(place[name], place[target]) for target in sorted(targets)]
    for name, (x, y) in place.items():
        parts.append(f'<rect x="{x}" y="{y}" width="{BOX[0]}" height="{BOX[1]}" rx="6"/>')
        parts.append(f'<text x="{x + 12}" y="{y + 20}">{escape(name.split("/")[1])}</text>')
        size = f"{lines[name]:,} lines"
        parts.append(f'<text class="size" x="{x + BOX[0] - 10}" y="{y + 20}" text-anchor="end">{size}</text>')
    return "\n".join([*parts, "</svg>", ""])


def arrow(start: tuple[float, float], end: tuple[float, float]) -> str:
    """Return an arrow from the folder that imports to the one it imports from: straight, round, or across."""
    (x, y), (to_x, to_y) = start, end
    middle, to_middle = y + BOX[1] / 2, to_y + BOX[1] / 2
    if x == to_x and y - to_y == STEP:
        return f'<path d="M{x + BOX[0] / 2} {y}V{to_y + BOX[1]}"/>'
    if x == to_x:
        out = x - 14 - 11 * (y - to_y) / STEP
        return f'<path d="M{x} {middle}C{out:.0f} {middle} {out:.0f} {to_middle} {x} {to_middle}"/>'
    side, to_side = (x, to_x + BOX[0]) if to_x < x else (x + BOX[0], to_x)
    bend = (side + to_side) / 2
    return f'<path class="across" d="M{side} {middle}C{bend} {middle} {bend} {to_middle} {to_side} {to_middle}"/>'


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(drawn(*folders()), encoding="utf-8")
