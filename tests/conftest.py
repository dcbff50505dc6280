from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from pipeline.logs.messages import Log

# A machine that is busy with something else is no reason to fail; and every run draws other examples, so that two runs
# with half the usual number find as much as one.
settings.register_profile("unhurried", deadline=None, max_examples=50)
settings.load_profile("unhurried")


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Range tables go into a folder of this session, never into the user's cache."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MCL_CACHE_DIR", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="session")
def office(tmp_path_factory: pytest.TempPathFactory) -> Log:
    """The embedded sample: 434 scans of a drive through a made-up office, with the map and the truth."""
    from converters import convert
    from pipeline.logs.reader import read_log
    from pipeline.simulate import sample_dir

    sample = sample_dir()
    path = tmp_path_factory.mktemp("office") / "office.mcap"
    convert(
        [sample / "office.log.gz"],
        path,
        map_path=sample / "office.dat.gz",
        ground_truth=sample / "office_truth.tum",
    )
    return read_log(path)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Real recordings, kept beside the checkout: they are not the project's to ship."""
    path = Path(__file__).resolve().parents[2] / "shared" / "data"
    if not path.is_dir():
        pytest.skip(f"the real recordings are not here ({path})")
    return path
