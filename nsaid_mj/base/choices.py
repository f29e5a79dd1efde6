"""The words from which an argument is chosen, apart from the code that they stand for.

A command refuses any other word before that code is imported.
"""

from .errors import InvalidInput, UnknownName


class Choices(dict[str, tuple[str, ...]]):
    """Words by what they choose."""

    def check(self, kind: str, word: str) -> None:
        """Raises `UnknownName`, which lists the choices, unless the word is one of a kind."""
        if word not in self[kind]:
            raise UnknownName(kind, word, self[kind])


_LAWS = ("paper", "cone", "memory", "efficient")

CHOICES = Choices(
    {
        "law of a run": _LAWS,
        "law": ("batch", "efficient", "memory", "cone", "paper"),
        "column": (
            "rotor",
            "viscous",
            "coulomb",
            "stribeck",
            "load",
            "quadratic",
            "cubic",
            "spring",
            "offset",
        ),
        "column of a vehicle": ("manoeuvring", "damping", "offset"),
        "frame": ("ENU/FLU", "NED/FRD"),
        "criterion": ("bound", "condition", "d-optimal"),
        "method": ("conventional", *_LAWS, "ols", "wls", "tls", "rls", "ekf", "sysid"),
        "fitted model": ("identified", "sysid", "sysid-stock"),
        "tracking law": ("nullspace", "conventional", "computed_torque", "composite"),
        "engine": ("local", "dask"),
    }
)
"""Words by what they choose.

A law of a run is one of `NullspaceAID`; a law without more words is one of `identify`: the fit to
all rows at once, or one that also follows a log. Columns are those of a joint on a log, and those
of a vehicle beyond its sheet's. Frames are the axes of a vehicle's pose and twist: z up, or down.
The criterion of a design is the predicted standard deviation of the requested numbers; or, for
comparison, the condition number of the regressor on P_⊥, or minus the logarithm of the determinant
of its Gramian. Fitted models of a comparison are fitted to one half of the logs and predict the
other: ours, and `mujoco.sysid` with its best and its stock options, starting from the values of the
first file. Engines of a sweep are processes on this machine, or on a cluster.
"""


def numbers_in(flag: str, text: str, remedy: str) -> tuple[float, ...]:
    """The comma-separated numbers of a flag's text; raises `InvalidInput` if it has others."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError as error:
        raise InvalidInput(flag, "comma-separated numbers", text, remedy) from error
