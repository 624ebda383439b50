"""This lab's export: a run as blocks of columns that gnuplot reads."""

from __future__ import annotations

from pathlib import Path

from rig.export import Exporter, Source


def write(source: Source, folder: Path) -> list[Path]:
    """Write `loops.dat`: a block a point; time (s), displacement (m), force (N)."""
    path = folder / "loops.dat"
    with path.open("w", encoding="utf-8") as file:
        for point in source.run.points:
            file.write(f"# {point.id}\n")
            rows = zip(point.time_s, point.displacement_m, point.force_N, strict=True)
            file.writelines(f"{time_s:.6f} {u_m:.7f} {force_N:.3f}\n" for time_s, u_m, force_N in rows)
            file.write("\n\n")
    return [path]


EXPORTER = Exporter("my_lab_gnuplot", "run", "one file of blocks for gnuplot", write)
