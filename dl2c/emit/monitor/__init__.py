"""The C of exported monitors and policies, for a target without the runtime of the simulator."""
