"""Mutants of source files: which there are, and a sample of them by a seed.

The operators are mutmut's, but for the one that changes texts. Like mutmut, only the insides of functions are changed.
What only words an answer is left out by rule (``_is_wording``), as is what has no effect while the program runs.
"""

import ast
import random
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import libcst as cst
from libcst.metadata import CodeRange, MetadataWrapper, PositionProvider
from mutmut.mutation.mutators import mutation_operators, operator_string

_OPERATORS = [(kind, operator) for kind, operator in mutation_operators if operator is not operator_string]
_TEXTS = (cst.SimpleString, cst.FormattedString, cst.ConcatenatedString)
_NOT_MUTATED = (cst.Annotation, cst.Decorator, cst.Raise, *_TEXTS)
"""Types, what runs at import, refusals (all wording once their condition holds) and texts."""
_NOT_MUTATED_CALLS = {"isinstance", "len", "report"}
"""Those that mutmut leaves alone too, and ``report(share, text)``, which tells a client how far the work is."""
_NOT_MUTATED_ARGUMENTS = {"strict"}
"""``zip(…, strict=True)`` guards against a defect and does nothing in a program without it."""


@dataclass(frozen=True, slots=True)
class Mutant:
    """A file with one change.

    Attributes:
        file: the file, relative to the checkout.
        line: the line of the change.
        lines: the lines of the changed expression or statement, then the first one of its statement.
        kind: what was changed: ``argument``, ``assignment``, ``condition``, ``number`` or ``operator``.
        change: what stood there and what stands there now, on one line.
        source: the file's text with the change.
    """

    file: str
    line: int
    lines: tuple[int, ...]
    kind: str
    change: str
    source: str


def sample(checkout: Path, files: Iterable[str], count: int, seed: int) -> tuple[list[Mutant], int]:
    """``count`` mutants of the files, drawn evenly from all, and how many there are; all where there are fewer."""
    changes = {file: _Changes.of(checkout / file) for file in sorted(files)}
    places = [(file, number) for file, found in changes.items() for number in range(len(found.made))]
    drawn = sorted(random.Random(seed).sample(places, min(count, len(places))))  # noqa: S311  (not for secrets)
    return [changes[file].mutant(file, number) for file, number in drawn], len(places)


@dataclass(frozen=True, slots=True)
class _Change:
    node: cst.CSTNode
    instead: cst.CSTNode
    statement: cst.CSTNode


class _Changes(cst.CSTVisitor):
    """Collects all changes of a module."""

    def __init__(self, module: cst.Module, positions: Mapping[cst.CSTNode, CodeRange]) -> None:
        super().__init__()
        self.made: list[_Change] = []
        self._module, self._positions = module, positions
        self._functions = 0
        self._statements: list[cst.CSTNode] = []

    @classmethod
    def of(cls, path: Path) -> "_Changes":
        """The changes of a file."""
        wrapper = MetadataWrapper(cst.parse_module(path.read_text(encoding="utf-8")), unsafe_skip_copy=True)
        found = cls(wrapper.module, wrapper.resolve(PositionProvider))
        wrapper.module.visit(found)
        return found

    def mutant(self, file: str, number: int) -> Mutant:
        """The mutant of a change, by its number."""
        change = self.made[number]
        span, start = self._positions[change.node], self._positions[change.statement].start.line
        lines = (*range(span.start.line, span.end.line + 1), start)
        mutated = cst.ensure_type(self._module.deep_replace(change.node, change.instead), cst.Module).code
        ast.parse(mutated)  # a mutant that is no Python would count as killed
        changed = f"{self._one_line(change.node)}  ->  {self._one_line(change.instead)}"
        return Mutant(file, span.start.line, lines, _kind(change.node), changed, mutated)

    def _one_line(self, node: cst.CSTNode) -> str:
        return " ".join(self._module.code_for_node(node).split())

    def on_visit(self, node: cst.CSTNode) -> bool:
        """Collect the changes of a node; whether to look into it."""
        if isinstance(node, _NOT_MUTATED) or _is_left_alone(node):
            return False
        if isinstance(node, cst.FunctionDef):
            self._functions += 1
        if isinstance(node, cst.BaseStatement | cst.BaseSmallStatement):
            self._statements.append(node)
        if self._functions:
            self.made += [_Change(node, instead, self._statements[-1]) for instead in _instead_of(node)]
        return True

    def on_leave(self, original_node: cst.CSTNode) -> None:
        """Leave a function or a statement."""
        if isinstance(original_node, cst.FunctionDef):
            self._functions -= 1
        if self._statements and self._statements[-1] is original_node:
            self._statements.pop()


def _is_left_alone(node: cst.CSTNode) -> bool:
    if isinstance(node, cst.Param):  # a default is made at import
        return node.default is not None and not isinstance(node.default, cst.Name | cst.BaseNumber)
    if isinstance(node, cst.Arg):
        return node.keyword is not None and node.keyword.value in _NOT_MUTATED_ARGUMENTS
    return isinstance(node, cst.Call) and isinstance(node.func, cst.Name) and node.func.value in _NOT_MUTATED_CALLS


def _instead_of(node: cst.CSTNode) -> Iterator[cst.CSTNode]:
    for kind, operator in _OPERATORS:
        if isinstance(node, kind):
            yield from (instead for instead in operator(node) if not _is_wording(node, instead))


def _is_wording(node: cst.CSTNode, instead: cst.CSTNode) -> bool:
    """Whether a change takes away a text, or an argument that is left alone."""
    if isinstance(node, cst.Assign | cst.AnnAssign | cst.AugAssign):
        return isinstance(node.value, _TEXTS)
    if not (isinstance(node, cst.Call) and isinstance(instead, cst.Call)):
        return False
    kept = {id(argument) for argument in instead.args}
    gone = [argument for argument in node.args if id(argument) not in kept]
    return any(isinstance(argument.value, _TEXTS) or _is_left_alone(argument) for argument in gone)


def _kind(node: cst.CSTNode) -> str:
    if isinstance(node, cst.Call | cst.Lambda):
        return "argument"
    if isinstance(node, cst.Assign | cst.AnnAssign | cst.AugAssign):
        return "assignment"
    if isinstance(node, cst.BaseNumber):
        return "number"
    branches = (
        cst.IfExp | cst.BooleanOperation | cst.BaseCompOp | cst.ComparisonTarget | cst.Name | cst.Break | cst.Continue
    )
    return "condition" if isinstance(node, branches) else "operator"
