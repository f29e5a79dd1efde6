"""The persistent nullspace P_s(θ) with the only rank decision, and the excitation levels."""

from .persistence import PersistenceMonitor as PersistenceMonitor
from .persistence import level as level
from .subspace import TOLERANCE as TOLERANCE
from .subspace import Nullspace as Nullspace
from .subspace import directions as directions
from .subspace import parts_of as parts_of
from .subspace import regressor_stack as regressor_stack
from .subspace import split as split
from .subspace import structural as structural
