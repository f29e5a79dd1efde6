from .designing import Design as Design
from .designing import design as design
from .experiment import Experiment as Experiment
from .information import asked_for as asked_for
from .limits import Limit as Limit
from .limits import Limits as Limits
from .limits import read_limits as read_limits
