"""BMW 320i: a car on a test ground with unknown load, tyres, drive and resistances."""

from nsaid_mj import BMW320iPlant, Driving, NullspaceAID, Scenario, main

scenario = Scenario(
    plant=BMW320iPlant(),
    excitation=Driving(
        speed=25.0,
        pace_low=0.02,
        pace_high=0.08,
        grip=5.0,
        steer_low=0.5,
        steer_high=3.0,
        ground=1000.0,
    ),
    identifier=NullspaceAID(K=3.0, gain=0.005, rate=5.0),
    initial_error=0.3,
    duration=600.0,
    dt=0.004,
    pe_window=20.0,
    held_out=30.0,
)

if __name__ == "__main__":
    main(scenario)
