"""Made-up buildings and drives through them: raw logs and maps whose truth is known."""

from __future__ import annotations

from pathlib import Path

from pipeline.errors import MclError
from pipeline.simulate.building import Building, load_building
from pipeline.simulate.files import Format, SimulationReport, chosen_format, output_names, simulate
from pipeline.simulate.simulation import Simulated, simulate_log

__all__ = [
    "SAMPLE_SEED",
    "Building",
    "Format",
    "Simulated",
    "SimulationReport",
    "chosen_format",
    "load_building",
    "output_names",
    "sample_dir",
    "simulate",
    "simulate_log",
]

SAMPLE_SEED = 16833


def sample_dir() -> Path:
    """The folder of the embedded sample: building.yaml, office.log.gz, office.dat.gz, office_truth.tum.

    In a wheel it lies inside the package, in a checkout under data/. Raises MclError if it is in neither.
    """
    package = Path(__file__).parents[1]
    for folder in (package / "sample", package.parent / "data" / "sample"):
        if (folder / "building.yaml").is_file():
            return folder
    raise MclError("the embedded sample is missing", "install again, or check the data/sample folder of the checkout")
