"""All benchmarks in one run.

    python tests/benchmarks [--json FILE] [--repeats N] [--only PART ...] [--huge]

The exit code is 1 if a bound is missed. What scenes cost is another table, which ``costs.py`` makes
and adds to the file.
"""

from __future__ import annotations

import sys

import bench_arrays
import bench_calculator
import bench_commands
import bench_compilation
import bench_crystals
import bench_effective
import bench_friction
import bench_motion
import bench_networks
import bench_ordered
import bench_pulses
import bench_sensitivities
import bench_simulation
import bench_statics
import bench_sweeps
import bench_times
import bench_waves
from side_by_side import command_line

# simulations first: their memory is measured in processes that inherit the peak of this one
PARTS = (
    bench_simulation.PARTS
    | bench_arrays.PARTS
    | bench_statics.PARTS
    | bench_ordered.PARTS
    | bench_crystals.PARTS
    | bench_calculator.PARTS
)
PARTS |= bench_effective.PARTS | bench_pulses.PARTS | bench_waves.PARTS | bench_sweeps.PARTS
PARTS |= (
    bench_commands.PARTS
    | bench_friction.PARTS
    | bench_motion.PARTS
    | bench_times.PARTS
    | bench_networks.PARTS
)
PARTS |= bench_compilation.PARTS | {"factors": bench_waves.factors}
PARTS |= bench_sensitivities.PARTS

if __name__ == "__main__":
    sys.exit(
        command_line(
            "Benchmarks of granphon", PARTS, bench_simulation.HUGE_PARTS | bench_times.HUGE_PARTS
        )
    )
