"""A scenario's fields as flags, the most important ones first.

Every field of a scenario and of its parts is a flag by its dotted name, `--plant.robot`. The last
name, `--robot`, or any other end of the dotted name works if it is unambiguous.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import Field, field, fields, make_dataclass
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, get_type_hints

import tyro

from ..base import with_homes
from ..robots import VehicleFiles, robot_file
from .plants.world.config import PlantConfig
from .plants.world.faults.kinds import Fault
from .plants.world.faults.text import fault_text
from .scenario import REGISTRY, Scenario, field_at, field_paths, same_end, with_fields

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

MAIN = {
    "identifier.law": "law",
    "plant.robot": "robot",
    "duration": "duration",
    "sensors": "sensors",
    "seed": "seed",
    "plant.backend": "backend",
}
"""Fields at the top of every command's help, and their flags."""
_ORDER = ("law", "robot", "duration", "sensors", "seed", "out", "force", "backend")

_RUNS = ("run", "verify")
"""Commands that run a scenario once."""

_EXCITATION = """
--excitation designed designs the motion first, --excitation designed:FOLDER takes one that
`nsaid excite` has designed."""

_Options = TypeVar("_Options", bound="DataclassInstance")


class ScenarioFlags:
    """The flags of a scenario, whose defaults are the values in its script.

    Args:
        name: of the scenario, as on the command line.
        default: the scenario as its script defines it.
    """

    def __init__(self, name: str, default: Scenario) -> None:
        self._name = name
        self._default = default

    def parsed(
        self, arguments: Sequence[str], command: str, options: type[_Options]
    ) -> tuple[Scenario, _Options]:
        """Parses what follows the name on a command line, and checks the robot's name.

        See `parse_flags` for the options and what is returned.

        Raises:
            NsaidError: a field's value is refused, or there is no such robot or vehicle.
        """
        found, chosen = parse_flags(self._name, self._default, arguments, command, options)
        _check_plant(found.plant)
        return found, chosen

    def of(self, scenario: Scenario) -> tuple[str, ...]:
        """The flags of `nsaid run` that turn the scenario of the script into a given one."""
        default = self._default
        found = []
        for path in field_paths(default):
            value = field_at(scenario, path)
            if value == field_at(default, path):
                continue
            if isinstance(value, bool):
                parent, _, last = path.rpartition(".")
                found.append(f"--{parent}{'.' if parent else ''}{'' if value else 'no-'}{last}")
            else:
                words = value if isinstance(value, tuple) else (value,)
                found += [
                    f"--{path}",
                    *(fault_text(w) if isinstance(w, Fault) else str(w) for w in words),
                ]
        return tuple(found)


def parse_flags(
    name: str, default: Scenario, arguments: Sequence[str], command: str, options: type[_Options]
) -> tuple[Scenario, _Options]:
    """Parses the part of a command line that follows a scenario's name.

    `default` is the scenario as its script defines it. The options of a command of `nsaid`, a
    dataclass, take precedence over fields of the scenario with the same name, which are then not
    available as flags.

    Returns:
        The scenario with the fields given as flags replaced, and the command's options.
    """
    own = {f.name for f in _fields(options)}
    paths = [path for path in field_paths(default) if path not in own]
    main = {path: flag for path, flag in MAIN.items() if path in paths}
    form = _form(
        default,
        [path for path in paths if path not in main],
        _head(default, main, options, command in _RUNS),
    )
    filled = tyro.cli(
        form,
        prog=f"nsaid {command} {name}",
        description=f"Flags of `nsaid {command} {name}`; the defaults are those of the scenario."
        + (_EXCITATION if command in _RUNS else ""),
        args=[_spelled(argument, paths, main, own) for argument in arguments],
        config=(tyro.conf.AvoidSubcommands,),
        registry=REGISTRY,
    )
    given = {path: getattr(filled, flag) for path, flag in main.items()}
    given |= {path: field_at(filled, path) for path in paths if path not in main}
    changed = {path: new for path, new in given.items() if new != field_at(default, path)}
    chosen: dict[str, Any] = {"scenario": name} | {key: getattr(filled, key) for key in own}
    return with_fields(default, changed), with_homes(options(**chosen))


def _fields(options: Any) -> list[Field[Any]]:
    """A command's own options: all but the scenario's name."""
    return [f for f in fields(options) if f.name != "scenario"]


_Field = tuple[str, Any, Any]


def _head(default: Scenario, main: Mapping[str, str], options: type, mixed: bool) -> list[_Field]:
    """The fields at the top: a command's own options, and the main fields of the scenario.

    They are `mixed` in the order of `_ORDER`, or the options come first.
    """
    helps = _helps(options)
    hints = get_type_hints(options, include_extras=True)
    own = [
        (
            f.name,
            tyro.conf.FlagCreatePairsOff[
                Annotated[hints[f.name], tyro.conf.arg(help=helps.get(f.name))]
            ],
            field(default=f.default),
        )
        for f in _fields(options)
    ]
    head = [_flag(default, path, flag) for path, flag in main.items()]
    if not mixed:
        return own + head
    place = {name: i for i, name in enumerate(_ORDER)}
    return sorted(own + head, key=lambda item: place.get(item[0], len(place)))


def _flag(scenario: Scenario, path: str, name: str) -> _Field:
    """One field of a scenario as a field of the flags dataclass."""
    parent, _, last = path.rpartition(".")
    part = field_at(scenario, parent)
    hint = get_type_hints(type(part), include_extras=True)[last]
    text = tyro.conf.arg(help=_helps(type(part)).get(last), help_behavior_hint=_default)
    return name, Annotated[hint, text], field(default=getattr(part, last))


def _default(value: str) -> str:
    """What a flag's help says of its default; nothing where there is none."""
    return f"(default: {value})" if value not in ("", "None") else ""


def _form(
    scenario: Scenario, paths: Sequence[str], head: Sequence[_Field] = (), at: str = ""
) -> type:
    """Makes a dataclass with the fields `paths` of a scenario, nested like the scenario."""
    items: dict[str, _Field] = {item[0]: item for item in head}
    for path in paths:
        name, _, rest = path.removeprefix(at).partition(".")
        if rest and name not in items:
            here = f"{at}{name}."
            nested = _form(scenario, [p for p in paths if p.startswith(here)], at=here)
            items[name] = (name, nested, field(default_factory=nested))
        elif not rest:
            items[name] = _flag(scenario, path, name)
    short = {"__module__": __package__}  # tyro looks for comments in the file of the module
    return make_dataclass("Flags", items.values(), frozen=True, kw_only=True, namespace=short)


def _helps(cls: type) -> dict[str, str]:
    """Attribute descriptions from the docstrings of a class and its bases, by attribute."""
    found: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        _, _, attributes = (base.__doc__ or "").partition("Attributes:\n")
        for name, text in re.findall(r"^ {8}(\w+): (.*(?:\n {9,}.*)*)", attributes, re.MULTILINE):
            found[name] = " ".join(text.split())
    return found


def _spelled(argument: str, paths: Sequence[str], main: Mapping[str, str], own: set[str]) -> str:
    """A flag with its name in the parser: `--robot` for `--plant.robot`, for instance."""
    if not argument.startswith("--"):
        return argument
    flag, equals, value = argument[2:].partition("=")
    wanted = flag.replace("-", "_")
    if wanted in own or wanted in main.values():
        return argument
    same = [wanted] if wanted in paths else same_end(wanted, paths)
    refused = same_end(wanted.removeprefix("no_"), paths)
    if len(same) == 1:
        flag = main.get(same[0], same[0])
    elif not same and len(refused) == 1 and wanted.startswith("no_"):  # a boolean field
        parent, _, last = refused[0].rpartition(".")
        flag = f"{parent}.no-{last}"
    return f"--{flag}{equals}{value}"


def _check_plant(plant: PlantConfig) -> None:
    """Raises an error if there is no such robot or vehicle as a plant of this package names."""
    from .plants.jointed import JointedPlant

    if isinstance(plant, JointedPlant):
        robot_file(plant.robot)
        return
    from .plants.world.blueprint import VehiclePlant

    if isinstance(plant, VehiclePlant):
        VehicleFiles.of(plant.vehicle)
