"""Types with bounds for the fields of a configuration, and errors that name the field.

A configuration is a frozen dataclass that derives from `Config` and is decorated with `config`.
Pydantic checks every field against its annotation whenever an object is made; its errors are raised
as `InvalidInput`. In JSON each configuration has the name of its class under `$type`.
"""

import functools
import inspect
import math
from dataclasses import field, fields
from importlib import import_module
from typing import Annotated, Any, ClassVar, TypeVar, dataclass_transform

from pydantic import (
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    ModelWrapValidatorHandler,
    TypeAdapter,
    ValidationError,
    model_serializer,
    model_validator,
)
from pydantic.dataclasses import dataclass
from pydantic_core import PydanticCustomError

from .errors import InvalidInput

TYPE = "$type"
"""Key of a configuration's class in JSON; no field can have this name."""

LARGEST = 1e15
"""Upper bound of physical quantities in SI units; its fourth power is far below overflow."""

Number = Annotated[float, Field(strict=True, ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, Field(strict=True, gt=0, le=LARGEST)]
NonNegative = Annotated[float, Field(strict=True, ge=0, le=LARGEST)]
PositiveShare = Annotated[float, Field(strict=True, gt=0, le=1)]

_HELP = "`nsaid run NAME --help` lists what every field takes."
_STRICT = ConfigDict(allow_inf_nan=False, extra="forbid", str_max_length=4096)
_C = TypeVar("_C", bound=type)


@dataclass_transform(frozen_default=True, field_specifiers=(field, Field))
def config(cls: _C) -> _C:
    """Decorator: a frozen dataclass whose fields are checked against their annotations.

    Numbers must be finite, and text such as can be written as UTF-8. With the types of this module
    neither `True` nor `"3"` is a number, and
    1.0 is not an integer. A list is accepted where a tuple is declared.
    """
    made: Any = dataclass(frozen=True, config=_STRICT)(cls)
    checked = made.__init__
    names = list(inspect.signature(made).parameters)

    @functools.wraps(checked)
    def init(self: Any, *args: Any, **values: Any) -> None:
        try:
            checked(self, *args, **values)
        except ValidationError as error:
            raise type(self).refusal(error, names) from None

    made.__init__ = init
    return made


@config
class Config:
    """Base of all configurations.

    Attributes:
        _path: the dotted path of such a configuration in a scenario, for messages.
    """

    _path: ClassVar[str] = ""

    @classmethod
    def kinds(cls) -> dict[str, type[Any]]:
        """All concrete subclasses by name, and the class itself if concrete.

        Subclasses defined in scripts count once the script is loaded.
        """
        found: dict[str, type[Any]] = {}
        if not inspect.isabstract(cls):
            found[cls.__name__] = cls
        for subclass in cls.__subclasses__():
            found |= subclass.kinds()
        return found

    @classmethod
    def refusal(
        cls, error: ValidationError, names: list[str] | None = None, remedy: str = ""
    ) -> InvalidInput:
        """Converts pydantic's first error about a configuration to one that names the field.

        `names` are the arguments' names by position; the default remedy is the field's default
        value.
        """
        first = error.errors(include_url=False)[0]
        cause = first.get("ctx", {}).get("error")
        if isinstance(cause, InvalidInput):
            return cause  # raised by a validator of several fields
        where = [*first["loc"]]
        if where and isinstance(where[0], int) and names and where[0] < len(names):
            where[0] = names[where[0]]
        dotted = ".".join(str(part) for part in (cls._path, *where) if part not in ("", "[key]"))
        expected = first["msg"].removeprefix("Input should be ").replace("a valid ", "a ")
        if expected.startswith(("greater", "less")):
            expected = f"a number {expected}"
        elif first["type"] == "unexpected_keyword_argument":
            known = [f.name for f in fields(cls)]
            expected = f"a field of {cls.__name__}"
            remedy = f"It has {', '.join(known)}."
        if not remedy:
            defaults = {f.name: f.default for f in fields(cls)}
            default = defaults.get(str(where[0])) if where else None
            remedy = f"The default is {default}." if _plain(default) else _HELP
        return InvalidInput(dotted or cls.__name__, expected, first["input"], remedy)

    @model_validator(mode="wrap")
    @classmethod
    def _read(cls, value: Any, handler: ModelWrapValidatorHandler[Any]) -> Any:
        """Accepts an instance, or a mapping whose `$type` names this class or a subclass."""
        if isinstance(value, cls) and "__pydantic_validator__" not in vars(type(value)):
            # a user's subclass that is a plain dataclass, so its fields are not checked yet
            parts = {f.name: getattr(value, f.name) for f in fields(value) if f.init}
            return _adapter(type(value)).validate_python(parts | {TYPE: type(value).__name__})
        if not isinstance(value, dict):
            return handler(value)
        name = value.get(TYPE)
        if isinstance(name, str):
            public = import_module(__name__.partition(".")[0])
            getattr(public, name, None)  # imports the class, if it is a public one
        kinds = cls.kinds()
        if not isinstance(name, str) or name not in kinds:
            known = ", ".join(kinds)
            raise PydanticCustomError("kind", "{known}", {"known": f"a {TYPE} out of {known}"})
        if kinds[name] is not cls:
            return _adapter(kinds[name]).validate_python(value)
        return handler({key: item for key, item in value.items() if key != TYPE})

    @model_serializer
    def _write(self) -> dict[str, Any]:
        """The class's name under `$type`, then the fields of the instance's own class."""
        return {TYPE: type(self).__name__} | {f.name: getattr(self, f.name) for f in fields(self)}

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: Any, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """The schema of the fields and `$type`; for an abstract class, of all its subclasses.

        Within a part of its own kind, as a driver in a sequence of drivers, only `$type` is stated.
        """
        if inspect.isabstract(cls):
            kinds = cls.kinds()
            if cls in _open:
                return {"properties": {TYPE: {"enum": list(kinds)}}, "required": [TYPE]}
            _open.append(cls)
            try:
                made = [_typed(k, _adapter(k).core_schema, handler) for k in kinds.values()]
            finally:
                _open.remove(cls)
            return {"oneOf": made}
        return _typed(cls, core_schema, handler)


_open: list[type[Config]] = []
"""Abstract classes whose schemas are being made."""


def _typed(cls: type, core_schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
    """The JSON schema of a class, including the key `$type` that discriminates it."""
    found = handler.resolve_ref_schema(handler(core_schema))
    found["properties"] = {TYPE: {"const": cls.__name__}} | found.get("properties", {})
    found["required"] = [TYPE, *found.get("required", [])]
    return found


@functools.cache
def _adapter(cls: type) -> TypeAdapter[Any]:
    return TypeAdapter(cls)


def _plain(value: object) -> bool:
    return value is None or isinstance(value, int | float | str | tuple)


def without_nonfinite(value: Any) -> Any:
    """A copy of JSON-like data in which NaN and infinities are None, for strict JSON."""
    if isinstance(value, dict):
        return {key: without_nonfinite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [without_nonfinite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
