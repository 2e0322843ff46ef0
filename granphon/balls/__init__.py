"""Balls: material and contact law, lattices, distributions of diameters, packings, loads."""
