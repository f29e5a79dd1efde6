"""The words from which an argument is chosen, apart from the code that they stand for.

A command refuses any other word before that code is imported; and numbers that are none.
"""

from collections.abc import Collection

from .errors import InvalidInput, UnknownName

LAWS = ("paper", "cone", "memory", "efficient")
"""The laws of `core.NullspaceAID`."""

IDENTIFICATION_LAWS = ("batch", "efficient", "memory", "cone", "paper")
"""The laws of `identify`: the fit to all rows at once, and those that also follow a log."""

JOINT_COLUMNS = (
    "rotor",
    "viscous",
    "coulomb",
    "stribeck",
    "load",
    "quadratic",
    "cubic",
    "spring",
    "offset",
)
"""Columns of a joint on a log; see `clinic.identify.choose.columns.COLUMNS`."""

VEHICLE_COLUMNS = ("damping", "offset")
"""Columns of a vehicle on a log, beyond those of its sheet."""

FRAMES = ("ENU/FLU", "NED/FRD")
"""Axes of a vehicle's pose and twist: z up, or down."""

CRITERIA = ("bound", "condition", "d-optimal")
"""Criteria that a design minimises: the predicted standard deviation of the requested numbers; or,
for comparison, the condition number of the regressor on P_⊥, or minus the logarithm of the
determinant of its Gramian."""

LIMITS_FORM = "For example: speed = 2.0; position = {low = -1.5, high = 1.5}; contacts = true."
"""How a file of limits looks."""

METHODS = ("conventional", *LAWS, "ols", "wls", "tls", "rls", "ekf", "sysid")
"""Methods of a comparison."""

FITTED = ("identified", "sysid", "sysid-stock")
"""Models of a comparison that are fitted to one half of the logs and predict the other: ours, and
`mujoco.sysid` with its best and its stock options, starting from the values of the first file."""

TRACKING_LAWS = ("nullspace", "conventional", "computed_torque", "composite")
"""Laws of adaptive tracking."""

ENGINES = ("local", "dask")
"""Engines of a sweep: processes on this machine, or on a cluster."""


def check_choice(kind: str, word: str, choices: Collection[str]) -> None:
    """Raises `UnknownName`, which lists the choices, unless the word is among them."""
    if word not in choices:
        raise UnknownName(kind, word, choices)


def numbers_in(flag: str, text: str, remedy: str) -> tuple[float, ...]:
    """The comma-separated numbers of a flag's text; raises `InvalidInput` if it has others."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError as error:
        raise InvalidInput(flag, "comma-separated numbers", text, remedy) from error
