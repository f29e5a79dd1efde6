"""F1TENTH, gently: straight ahead with varying speed, then a slalom."""

from nsaid_mj import Driving, F1TenthPlant, NullspaceAID, Phase, Scenario, Sequence, main

scenario = Scenario(
    plant=F1TenthPlant(),
    excitation=Sequence(
        phases={
            "straight": Phase(Driving(variation=0.55, grip=1e-6, ground=1e4), 20.0),
            "slalom": Phase(Driving(variation=0.55, ground=1e4), 20.0),
        }
    ),
    identifier=NullspaceAID(K=6.0, gain=6.0, rate=5.0, law="memory"),
    initial_error=0.3,
    duration=40.0,
    dt=0.004,
    pe_window=20.0,
    held_out=40.0,
)

if __name__ == "__main__":
    main(scenario)
