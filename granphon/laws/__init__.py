"""Contact laws of balls that differ: averaged force and effective medium."""
