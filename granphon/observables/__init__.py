"""What is found of a state: velocities, moduli, pulses, validity."""
