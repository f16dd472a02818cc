"""Imports point one way: of the files and rooms of a folder, no room is imported by what it imports.

`rigcast` stands on `sensors`, `sensors` on `kernels`, and so it goes on within each, folder by folder. An import counts
wherever it stands: in a function, and for a type checker alone, too.
"""

import ast
from collections import defaultdict
from collections.abc import Iterable, Iterator
from importlib.util import resolve_name
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parent.parent
PACKAGES = {"kernels": "rigcast.kernels", "sensors": "rigcast.sensors", "rigcast": "rigcast"}

Place = tuple[str, ...]
"""Where a module is: the folders that it is in, and its file."""


def places() -> dict[str, Place]:
    """Every module's place by its name."""
    found = [path.relative_to(CHECKOUT).parts for folder in PACKAGES for path in (CHECKOUT / folder).rglob("*.py")]
    return {_name(place): place for place in found}


def _name(place: Place) -> str:
    return ".".join([PACKAGES[place[0]], *place[1:]]).removesuffix(".py").removesuffix(".__init__")


def imports(known: dict[str, Place]) -> Iterator[tuple[Place, Place]]:
    """Who imports whom, of these modules."""
    for name, place in known.items():
        package = name if place[-1] == "__init__.py" else name.rpartition(".")[0]
        for node in ast.walk(ast.parse((CHECKOUT / Path(*place)).read_text(encoding="utf-8"))):
            for other in _imported(node, package, known):
                if other in known and other != name:
                    yield place, known[other]


def _imported(node: ast.AST, package: str, known: dict[str, Place]) -> Iterator[str]:
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom):
        source = resolve_name("." * node.level + (node.module or ""), package)
        for alias in node.names:
            yield f"{source}.{alias.name}" if f"{source}.{alias.name}" in known else source


def against(imports: Iterable[tuple[Place, Place]]) -> list[str]:
    """The imports that are part of a cycle with a room in it."""
    steps = {(a, b): _step(a, b) for a, b in imports}
    used: dict[Place, set[Place]] = defaultdict(set)
    for above, below in steps.values():
        used[above].add(below)
    reached = {place: _reached(place, used) for place in used}
    circle = {place: {x for x in found if place in reached.get(x, ())} for place, found in reached.items()}
    return [
        f"{'/'.join(a)} imports {'/'.join(b)}"
        for (a, b), (above, below) in steps.items()
        if below in circle[above] and not all(x[-1].endswith(".py") for x in circle[above])
    ]


def _step(a: Place, b: Place) -> tuple[Place, Place]:
    """The rooms of two modules, or the modules themselves, directly in the innermost folder that holds both."""
    shared = next(k for k in range(len(a)) if a[k] != b[k])
    return a[: shared + 1], b[: shared + 1]


def _reached(start: Place, used: dict[Place, set[Place]]) -> set[Place]:
    found: set[Place] = set()
    left = [start]
    while left:
        new = used.get(left.pop(), set()) - found
        found |= new
        left += new
    return found


def test_no_room_is_imported_by_what_it_imports() -> None:
    found = against(imports(places()))
    assert not found, "\n".join(found)


A, B = ("top", "a.py"), ("top", "b.py")
LOW, HIGH = ("top", "low", "x.py"), ("top", "high", "y.py")


@pytest.mark.parametrize(
    ("imports", "count"),
    [
        ([(A, B), (A, LOW), (HIGH, LOW), (HIGH, B)], 0),
        ([(A, B), (B, A), (A, LOW)], 0),
        ([(HIGH, LOW), (("top", "low", "z.py"), ("top", "high", "w.py"))], 2),
        ([(HIGH, LOW), (LOW, A), (A, HIGH), (B, A)], 3),
        ([(("top", "low", "deep", "x.py"), LOW), (LOW, ("top", "low", "deep", "x.py"))], 2),
    ],
    ids=["one way", "files of one folder", "two rooms", "rooms and a file", "a room in a room"],
)
def test_what_is_against_the_way_is_found(imports: list[tuple[Place, Place]], count: int) -> None:
    assert len(against(imports)) == count
