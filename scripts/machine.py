"""The machine and the software versions of a measurement."""

import os
import platform
from importlib.metadata import version
from pathlib import Path


def machine() -> dict[str, str | int | float]:
    """Processor, number of cores, current load, and versions."""
    cpuinfo, processor = Path("/proc/cpuinfo"), platform.processor()
    if cpuinfo.is_file():
        lines = cpuinfo.read_text(encoding="utf-8").splitlines()
        models = (line.split(":")[1].strip() for line in lines if line.startswith("model name"))
        processor = next(models, processor)
    return {
        "machine": platform.machine(),
        "processor": processor,
        "processors": os.cpu_count() or 1,
        "load": round(os.getloadavg()[0], 2),
        "python": platform.python_version(),
        **{name: version(name) for name in ("mujoco", "pin", "numpy", "numba")},
    }
