"""Inverse problems: the network that has the frequencies, gap, velocity or response you want."""
