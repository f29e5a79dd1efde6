"""Position servos from logs of (target, position), without torque: the law "output error".

given = servo_logs("arm.xml", ["log.csv"])  # None if the logs hold no targets
result = identify_servos(given)
write_servo_mjcf(result, Path("identified.xml"))

The names are listed in `__init__.pyi`; each is imported on first use.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
