"""BlueROV2 Heavy, gently: heave alone, then surge, then yaw, then all axes at once."""

from nsaid_mj import (
    AxisMultisine,
    BlueROV2Plant,
    MultisineCommand,
    NullspaceAID,
    Phase,
    Scenario,
    Sequence,
    main,
)

scenario = Scenario(
    plant=BlueROV2Plant(),
    excitation=Sequence(
        phases={
            "heave": Phase(AxisMultisine(("heave",), low=0.1, high=1.0), 15.0),
            "surge": Phase(AxisMultisine(("surge",), low=0.1, high=1.0), 15.0),
            "yaw": Phase(AxisMultisine(("yaw",), low=0.1, high=1.0), 15.0),
            "all": Phase(MultisineCommand(low=0.1, high=1.0), 15.0),
        }
    ),
    identifier=NullspaceAID(K=6.0, gain=0.6, law="memory"),
    initial_error=0.3,
    duration=60.0,
    dt=0.01,
    pe_window=20.0,
    held_out=60.0,
)

if __name__ == "__main__":
    main(scenario)
