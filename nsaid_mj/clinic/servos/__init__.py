"""Position servos from logs of (target, position), without torque: the law "output error".

given = servo_logs("arm.xml", ["log.csv"])  # None if the logs hold no targets
result = identify_servos(given)
write_servo_mjcf(result, Path("identified.xml"))
"""
