"""Holds the linear algebra libraries at one thread, so that results do not depend on the machine.

With more threads they sum in another order and round differently. Our matrices are too small to
gain from threads.
"""

import scipy.linalg.blas  # noqa: F401 (SciPy's own BLAS must be loaded before it can be limited)
from threadpoolctl import threadpool_limits

single_threaded = threadpool_limits.wrap(limits=1)
"""Decorator of functions during which BLAS and OpenMP use a single thread."""
