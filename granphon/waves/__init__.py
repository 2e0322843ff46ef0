"""Waves in a finite network of contacts: densities of states, spectral functions, modes, pulses in
time.
"""
