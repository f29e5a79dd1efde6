"""One robot's equations as data, and the kernels that evaluate them. No MuJoCo, no true value."""

from .. import numerics as numerics  # sets the cache folder before the first kernel is defined
