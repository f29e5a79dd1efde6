"""Translates all kernels to LLVM's code, which the package brings: see `core/numerics/shipped.py`.

Run it after every edit of a kernel's file that is to be released: `python scripts/kernels.py`. It
takes a few minutes. What it writes depends on the platform, numba and the sources only.
"""

import importlib
import pkgutil
import time

import nsaid_mj
from nsaid_mj.core.laws.cone.law import ConeMetric
from nsaid_mj.core.laws.metric import ConstantMetric, descent_in
from nsaid_mj.core.laws.rk4 import flow_in, flow_together_in
from nsaid_mj.core.numerics import shipped
from nsaid_mj.core.numerics.kernels import KERNELS


def main() -> None:
    """Imports everything that defines a kernel, and writes the file for this platform."""
    shipped.path().unlink(missing_ok=True)
    for module in pkgutil.walk_packages(nsaid_mj.__path__, "nsaid_mj."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    for metric in (ConstantMetric, ConeMetric):
        flow_in(metric)
        descent_in(metric)
    flow_together_in(ConstantMetric)
    begin = time.process_time()
    portable = {name: kernel for name, kernel in KERNELS.items() if not kernel.py_func.__closure__}
    for kernel in portable.values():
        kernel.renew()
    made = {name: kernel.translated() for name, kernel in portable.items()}
    shipped.write(made)
    size = shipped.path().stat().st_size
    seconds = time.process_time() - begin
    print(f"{len(made)} kernels, {size / 1e3:.0f} kB, {seconds:.0f} CPU s: {shipped.path()}")


if __name__ == "__main__":
    main()
