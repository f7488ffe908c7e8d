"""OpenSCENARIO XML files as parameters with ranges, expressions, and elements; what they mean is decided elsewhere.

A file is a scenario with parameter declarations, or a distribution of the parameters of another file. Files are
untrusted: size and depth are limited, document types and entities are refused, and every file that one refers to must
be in an allowed folder.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from lxml import etree
from pydantic import ValidationError

from ...schemas.errors import InvalidRequest, UnknownName, UnsafeInput
from ...schemas.exploration import Distribution, Parameter
from ...schemas.text import cited, shown_name
from ..commonroad import XmlLimits, scan_xml
from .formulas import names_in, value_of

_LIMITS = XmlLimits(size_bytes=5_000_000, depth=64, elements=100_000, tag_bytes=100_000)
"""Chosen: about a hundred times the largest file of ASAM's example scenarios (40 kB)."""
_MOST_CATALOG_FILES, _MOST_FOLDERS, _DEEPEST = 200, 8, 20
"""Files of a catalogue's folder, folders of catalogues (OpenSCENARIO has 8 kinds), and parameters in turn (chosen)."""
_TAIL = 0.001
"""The share of values beyond each end of a range that a distribution leaves open (chosen)."""
_NUMERIC = ("double", "integer", "int", "unsignedInt", "unsignedShort")
_REFERENCE = re.compile(r"\$(\w+)")
WRITE_YAML = "leave it out of the file, or write the logical scenario as YAML"
"""The remedy for an element without a counterpart."""


def parsed(path: Path) -> etree._Element:
    """Return the root element of an OpenSCENARIO XML 1.x file, without comments and namespaces.

    Raises:
        UnsafeInput: the file is too large, broken or hostile, or is not OpenSCENARIO XML.
    """
    name = scan_xml(path, _LIMITS).name
    if name.rpartition(":")[2] != "OpenSCENARIO":
        raise UnsafeInput(
            f"{shown_name(path.name)} is not OpenSCENARIO XML: its root element is <{shown_name(name)}>",
            valid=["<OpenSCENARIO>, version 1.0 to 1.3"],
        )
    parser = etree.XMLParser(resolve_entities=False, no_network=True, remove_comments=True, remove_pis=True)
    try:
        root = etree.parse(path, parser).getroot()
    except (etree.LxmlError, OSError) as error:
        raise UnsafeInput(f"{shown_name(path.name)} cannot be read: {cited(error)}") from error
    for element in root.iter(etree.Element):
        element.tag = etree.QName(element).localname
    return root


@dataclass
class OpenScenario:
    """A scenario file with its parameters.

    ``file``: its shown name. ``declared``: the declared value of each parameter as text. ``varied``: the parameters
    with a range, by their declared names. ``notes``: what was left out. ``allowed``: returns the path of a file that
    may be read, or raises OutsideRoots.
    """

    path: Path
    root: etree._Element
    allowed: Callable[[str], Path]
    declared: dict[str, str]
    varied: dict[str, Parameter]
    notes: list[str] = field(default_factory=list)
    structural: set[str] = field(default_factory=set)
    used: dict[str, None] = field(default_factory=dict)
    _open: set[str] = field(default_factory=set)

    @property
    def file(self) -> str:
        """The name of the file, as shown."""
        return shown_name(self.path.name)

    def formula(self, text: str, local: Mapping[str, str] | None = None) -> str:
        """Return an attribute's value as a formula over the parameters' own names, or as a number.

        Args:
            text: a number, ``$name`` or ``${expression}``.
            local: the values of parameters that the story declares.

        Raises:
            InvalidRequest: it is neither a number nor an expression.
        """
        inner = text.strip()
        if inner.startswith("${") and inner.endswith("}"):
            inner = inner[2:-1]
        found = _REFERENCE.sub(lambda match: self._referred(match[1], local or {}), inner).strip()
        value_of(found, self.values, self.file)
        if not names_in(found) & self.values.keys():
            return f"{value_of(found, {}, self.file):.9g}"
        return f"({found})"

    def _referred(self, name: str, local: Mapping[str, str]) -> str:
        if name in local:
            return self._inner(name, local[name])
        if name not in self.declared:
            raise UnknownName(f"{self.file} refers to ${name}, which it does not declare", valid=list(self.declared))
        if self.declared[name].strip().startswith("$"):
            return self._inner(name, self.declared[name])
        if own_name(name) not in self.values:
            raise InvalidRequest(
                f"{self.file}: ${name} is '{shown_name(self.declared[name])}', not a number",
                next_step="give the parameter a number in the file",
            )
        self.used[name] = None
        return own_name(name)

    def _inner(self, name: str, text: str) -> str:
        """Return the formula of a parameter that is given by another one."""
        if name in self._open or len(self._open) >= _DEEPEST:
            raise InvalidRequest(
                f"{self.file}: ${shown_name(name)} refers to itself, or to more than {_DEEPEST} others in turn",
                next_step="give it a number in the file",
            )
        self._open.add(name)
        found = self.formula(text)
        self._open.discard(name)
        return found

    @property
    def values(self) -> dict[str, float]:
        """The declared values of the numeric parameters, by their own names."""
        return {own_name(name): value for name, text in self.declared.items() if (value := _number(text)) is not None}

    def now(self, formula: str) -> float:
        """Return the value of a formula for the declared values."""
        return value_of(formula, self.values, self.file)

    def fixed(self, text: str, local: Mapping[str, str] | None = None) -> float:
        """Return the declared value of an attribute that decides the story's form, such as a lane.

        Its parameters cannot be varied.
        """
        texts = [text, *((local or {}).get(name, "") for name in _REFERENCE.findall(text))]
        self.structural.update(name for one in texts for name in _REFERENCE.findall(one) if name in self.declared)
        return self.now(self.formula(text, local))

    def fixed_formula(self, formula: str) -> float:
        """Return the value of a formula for the declared values; its parameters cannot be varied."""
        names = names_in(formula)
        self.structural.update(name for name in self.declared if own_name(name) in names)
        return self.now(formula)

    def text(self, text: str, local: Mapping[str, str] | None = None) -> str:
        """Return the text of an attribute; a parameter gives its declared value."""
        match = re.fullmatch(r"\$(\w+)", text.strip())
        if match is None:
            return text.strip()
        if local and match[1] in local:
            return local[match[1]]
        if match[1] not in self.declared:
            raise UnknownName(
                f"{self.file} refers to ${match[1]}, which it does not declare", valid=list(self.declared)
            )
        self.structural.add(match[1])
        return self.declared[match[1]]

    def parameters(self) -> tuple[tuple[Parameter, ...], dict[str, str]]:
        """Return the parameters of the story, and the constants among its numbers.

        A parameter that decides the story's form keeps its declared value. A number without a range is a parameter
        that varies only in a given range.
        """
        found: list[Parameter] = []
        constants: dict[str, str] = {}
        for name in self.declared:
            value = self.values.get(own_name(name))
            if name in self.structural:
                if name in self.varied:
                    self.notes.append(f"{name} keeps its declared value {shown_name(self.declared[name])}")
                if value is not None and name in self.used:
                    constants[own_name(name)] = f"{value:.9g}"
            elif name in self.varied and name not in self.used:
                self.notes.append(f"{name} has no effect on what was read")
            elif name in self.varied:
                found.append(self.varied[name])
            elif name in self.used and value is not None:
                found.append(Parameter(name=own_name(name), low=value, high=value, base=value))
        return tuple(sorted(found, key=lambda one: one.is_fixed)), constants

    def entry(self, catalog: str, name: str) -> etree._Element:
        """Return an entry of a catalogue.

        Raises:
            InvalidRequest: there is no such entry.
            OutsideRoots: the catalogue's folder is not allowed.
        """
        for folder in self.root.findall("CatalogLocations/*/Directory")[:_MOST_FOLDERS]:
            path = self.allowed(str(self.path.parent / self.text(folder.get("path", ""))))
            if not path.is_dir():
                continue
            for file in sorted(path.glob("*.xosc"))[:_MOST_CATALOG_FILES]:
                root = parsed(self.allowed(str(file)))
                for one in root.iterfind("Catalog"):
                    if one.get("name") == catalog:
                        found = next((entry for entry in one if entry.get("name") == name), None)
                        if found is not None:
                            return found
        raise InvalidRequest(
            f"{self.file} refers to the entry '{shown_name(name)}' of the catalogue '{shown_name(catalog)}', "
            f"which was not found",
            valid=[folder.get("path", "") for folder in self.root.iterfind("CatalogLocations/*/Directory")],
            next_step="put the catalogue where the file says, or describe the vehicle in the file",
        )


def own_name(name: str) -> str:
    """Return a parameter's name in a logical scenario: in lower case."""
    found = re.sub(r"\W", "_", name, flags=re.ASCII).lower()
    return found if found[:1].isalpha() else f"p_{found}"


def open_scenario(path: Path, allowed: Callable[[str], Path]) -> OpenScenario:
    """Read a scenario with the ranges of its own constraints, or with those of a distribution that refers to it.

    Args:
        path: the file.
        allowed: returns the path of a file that may be read, or raises OutsideRoots.

    Raises:
        UnsafeInput: a file is too large, broken or hostile.
        OutsideRoots: the scenario's file is not in an allowed folder.
        InvalidRequest: a file is not a scenario, or a distribution cannot be used.
    """
    root = parsed(path)
    distribution = root.find("ParameterValueDistribution")
    if distribution is None:
        return _scenario(path, root, allowed)
    file = distribution.find("ScenarioFile")
    target = allowed(str(path.parent / ("" if file is None else file.get("filepath", ""))))
    found = _scenario(target, parsed(target), allowed)
    found.varied = {}
    for name, parameter in _distributed(distribution, found, shown_name(path.name)):
        if name not in found.declared:
            raise UnknownName(
                f"{shown_name(path.name)} varies '{shown_name(name)}', which {found.file} does not declare",
                valid=list(found.declared),
            )
        if parameter is not None:
            found.varied[name] = parameter
        else:
            found.structural.add(name)
            found.notes.append(f"{shown_name(name)} keeps its declared value {shown_name(found.declared[name])}")
    return found


def _scenario(path: Path, root: etree._Element, allowed: Callable[[str], Path]) -> OpenScenario:
    if root.find("Storyboard") is None:
        raise InvalidRequest(
            f"{shown_name(path.name)} has no <Storyboard>",
            valid=["a scenario", "a <ParameterValueDistribution> with the <ScenarioFile> of a scenario"],
            next_step="give the file of the scenario, or of its distribution",
        )
    declarations = list(root.iterfind("ParameterDeclarations/ParameterDeclaration"))
    declared = {one.get("name", ""): one.get("value", "") for one in declarations}
    if len({own_name(name) for name in declared}) < len(declared):
        raise InvalidRequest(f"{shown_name(path.name)} declares names that differ only in case", valid=sorted(declared))
    found = OpenScenario(path, root, allowed, declared, {})
    for one in declarations:
        if one.get("parameterType") in _NUMERIC and (parameter := _constrained(one, found)) is not None:
            found.varied[one.get("name", "")] = parameter
    return found


def _constrained(declaration: etree._Element, scenario: OpenScenario) -> Parameter | None:
    """Return the range of the constraints of a declaration; None if they leave an end open."""
    lows, highs = [], []
    for one in declaration.iterfind("ConstraintGroup/ValueConstraint"):
        limit = _number(one.get("value", ""))
        if limit is not None and one.get("rule") in ("greaterThan", "greaterOrEqual"):
            lows.append(limit)
        elif limit is not None and one.get("rule") in ("lessThan", "lessOrEqual"):
            highs.append(limit)
    if not lows or not highs or min(highs) <= max(lows):
        return None
    name = declaration.get("name", "")
    return _parameter(name, max(lows), min(highs), scenario, None)


def _distributed(
    distribution: etree._Element, scenario: OpenScenario, file: str
) -> Iterator[tuple[str, Parameter | None]]:
    """Yield the varied parameters by their declared names; None for one with values that are not numbers."""
    kinds = ("DeterministicSingleParameterDistribution", "StochasticDistribution")
    tied: dict[str, list[str]] = {}
    for one in distribution.iter("ParameterAssignment"):
        tied.setdefault(one.get("parameterRef", ""), []).append(one.get("value", ""))
    if tied:
        scenario.notes.append(
            f"the combinations of the <ParameterValueSet> elements ({', '.join(map(shown_name, tied))}) are not kept"
        )
    for name, values in tied.items():
        numbers = [number for value in values if (number := _number(value)) is not None]
        if len(numbers) < len(values):
            yield name, None
            continue
        yield name, _parameter(name, min(numbers), max(numbers), scenario, None)
    for one in distribution.iter(*kinds):
        name = one.get("parameterName", "")
        for kind in one:
            try:
                yield name, _varied(name, kind, scenario, file)
            except ValidationError as error:
                raise InvalidRequest(
                    f"{file}: <{kind.tag}> of '{shown_name(name)}': {error.errors()[0]['msg']}"
                ) from error


def _varied(name: str, kind: etree._Element, scenario: OpenScenario, file: str) -> Parameter | None:
    source = f"{file}, {kind.tag}"
    limits = _range(kind.find("Range"), scenario)
    found: Distribution | None
    match kind.tag:
        case "DistributionSet" | "ProbabilityDistributionSet":
            bins = [
                (value, value, scenario.fixed(one.get("weight", "1")))
                for one in kind.iterfind("Element")
                if (value := _number(one.get("value", ""))) is not None
            ]
            if len(bins) < len(kind.findall("Element")) or not bins:
                return None
            # A deterministic set or range says what to test, not how often it occurs.
            is_stochastic = kind.tag == "ProbabilityDistributionSet"
            found = Distribution(kind="histogram", bins=tuple(bins), source=source) if is_stochastic else None
            limits = min(low for low, *_ in bins), max(high for _, high, _ in bins)
        case "DistributionRange" | "UniformDistribution" if limits is not None:
            found = Distribution(kind="uniform", source=source) if kind.tag == "UniformDistribution" else None
        case "NormalDistribution" | "LogNormalDistribution" | "PoissonDistribution":
            found = Distribution(
                kind={"N": "normal", "L": "lognormal", "P": "poisson"}[kind.tag[0]],
                mean=scenario.fixed(kind.get("expectedValue", "")),
                variance=scenario.fixed(kind.get("variance", "0")),
                source=source,
            )
            limits = limits or _likely(found)
        case "Histogram":
            bins = []
            for one in kind.iterfind("Bin"):
                low, high = _range(one.find("Range"), scenario) or (0.0, 0.0)
                bins.append((low, high, scenario.fixed(one.get("weight", "0"))))
            found = Distribution(kind="histogram", bins=tuple(bins), source=source)
            limits = min(low for low, *_ in bins), max(high for _, high, _ in bins)
        case _:
            raise InvalidRequest(
                f"{file}: <{kind.tag}> of '{shown_name(name)}' cannot be used",
                valid=[
                    *("DistributionSet", "DistributionRange", "ProbabilityDistributionSet", "UniformDistribution"),
                    *("NormalDistribution", "LogNormalDistribution", "PoissonDistribution", "Histogram"),
                ],
                next_step="give the parameter one of these",
            )
    return _parameter(name, *limits, scenario, found)


def _parameter(
    name: str, low: float, high: float, scenario: OpenScenario, distribution: Distribution | None
) -> Parameter | None:
    base = _number(scenario.declared.get(name, ""))
    if base is None:
        return None
    if low > high:
        raise InvalidRequest(f"{scenario.file}: {low:g} to {high:g} is not a range of '{shown_name(name)}'")
    within = min(max(base, low), high)
    return Parameter(name=own_name(name), low=low, high=high, base=within, distribution=distribution)


def _range(element: etree._Element | None, scenario: OpenScenario) -> tuple[float, float] | None:
    if element is None:
        return None
    low, high = (scenario.fixed(element.get(key, "")) for key in ("lowerLimit", "upperLimit"))
    return low, high


def _likely(distribution: Distribution) -> tuple[float, float]:
    """Return the range of a distribution without its tails, by bisection."""
    deviation = max(distribution.variance, distribution.mean if distribution.kind == "poisson" else 0.0) ** 0.5
    far = (distribution.mean - 10.0 * deviation, distribution.mean + 50.0 * deviation)

    def place(share: float) -> float:
        low, high = far
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if distribution.share_below(middle) < share else (low, middle)
        return float(f"{(low + high) / 2:.4g}")

    return place(_TAIL), place(1.0 - _TAIL)


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if abs(value) < 1e12 else None  # NaN too is refused
