"""Contact laws of balls that differ: averaged force, effective medium and clusters."""
