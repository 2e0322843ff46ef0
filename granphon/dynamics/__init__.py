"""The dynamics of a lattice of contacts: the compatibility matrix, modes, long waves, branches,
Green's function.
"""
