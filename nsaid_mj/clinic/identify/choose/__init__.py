"""What a log decides about a robot's structure: columns, delays, lags, curves, cut-offs, profiles.

`options` declares every option with its values and its criterion, and compares candidates by one
function; `columns` holds what an option adds to the robot's system. `structured` is the entry; the
searches of a tree of joints, of a vehicle and of servos are beside it.
"""
