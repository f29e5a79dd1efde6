"""Abstract or final: a method that has a body is never overridden."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from functools import cached_property
from importlib import import_module
from inspect import isabstract, isclass
from pkgutil import walk_packages
from types import FunctionType
from typing import Any, Protocol

import nsaid_mj


def function_of(value: Any) -> FunctionType | None:
    """The function behind a method, property, class method or static method; else None."""
    if isinstance(value, property):
        value = value.fget
    elif isinstance(value, cached_property):
        value = value.func
    elif isinstance(value, classmethod | staticmethod):
        value = value.__func__
    return value if isinstance(value, FunctionType) else None


def concrete_methods(base: type, package: str) -> set[str]:
    """Names of the methods and properties with a body that a class of the package defines.

    Special methods are left out, and so is what the standard library generates, as a NamedTuple's
    `_replace`: its function belongs to another module.
    """
    found = set()
    for name, value in vars(base).items():
        function = function_of(value)
        ours = function is not None and function.__module__.partition(".")[0] == package
        special = name.startswith("__") and name.endswith("__")
        abstract = getattr(value, "__isabstractmethod__", False) or Protocol in base.__bases__
        if ours and not special and not abstract:
            found.add(name)
    return found


def overrides(classes: set[type], package: str) -> Iterator[str]:
    """Every attribute of a class that hides a concrete method of one of its bases."""
    for cls in classes:
        for base in cls.__mro__[1:]:
            for name in sorted(concrete_methods(base, package) & set(vars(cls))):
                yield f"{cls.__module__}.{cls.__qualname__}.{name} overrides {base.__qualname__}'s"


def classes_of_the_package() -> set[type]:
    """All classes at the top level of the package's modules."""
    modules = [import_module(found.name) for found in walk_packages(nsaid_mj.__path__, "nsaid_mj.")]
    return {
        value
        for module in modules
        for value in vars(module).values()
        if isclass(value) and value.__module__ == module.__name__
    }


def test_no_class_overrides_a_concrete_method():
    classes = classes_of_the_package()
    assert {"Plant", "Driver", "Observer", "Log"} <= {cls.__name__ for cls in classes}
    assert sorted(overrides(classes, "nsaid_mj")) == []


def test_overridden_methods_and_properties_are_found():
    class Base(ABC):
        @abstractmethod
        def abstract(self): ...

        def method(self):
            return 0

        @property
        def read(self):
            return 0

        @cached_property
        def cached(self):
            return 0

        @staticmethod
        def static():
            return 0

        def __len__(self):
            return 0

    class Implementation(Base):
        def abstract(self): ...

        def __len__(self):
            return 1

    class Method(Implementation):
        def method(self):
            return 1

    values = {"read": 1, "cached": 2, "static": None}
    assert isabstract(Base)
    package = __name__.partition(".")[0]
    assert not list(overrides({Base, Implementation}, package))
    assert len(list(overrides({Method}, package))) == 1
    assert len(list(overrides({type("Values", (Implementation,), values)}, package))) == 3
    assert len(list(overrides({type("Deeper", (Method,), {"abstract": None})}, package))) == 1
