"""Identifiers: one file per law, over one engine. numpy and numba only."""

from .. import numerics as numerics  # sets the cache folder before the first kernel is defined
from .base import Confidence as Confidence
from .base import Estimates as Estimates
from .base import ExpectedGramian as ExpectedGramian
from .base import Identifier as Identifier
from .base import IdentifierConfig as IdentifierConfig
from .base import State as State
from .base import Status as Status
from .base import gain_deviations as gain_deviations
from .cone.law import ConeMetric as ConeMetric
from .config import NullspaceAID as NullspaceAID
from .conventional import ConventionalAID as ConventionalAID
from .efficient.estimator import EfficientConfig as EfficientConfig
from .efficient.estimator import KalmanFilter as KalmanFilter
from .efficient.law import EfficientIdentifier as EfficientIdentifier
from .efficient.signals import Signals as Signals
from .efficient.supervisor import Supervisor as Supervisor
from .faults import FaultEvent as FaultEvent
from .memory.implicit import ImplicitMemory as ImplicitMemory
from .memory.statistics import MemoryConfig as MemoryConfig
from .metric import ConstantMetric as ConstantMetric
from .metric import Metric as Metric
from .nullspace_aid import NullspaceIdentifier as NullspaceIdentifier
from .nullspace_aid import paper_identifier as paper_identifier
from .plain import NumpyIdentifier as NumpyIdentifier
