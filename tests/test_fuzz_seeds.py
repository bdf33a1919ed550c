"""The documents that the fuzzing of scenes starts from (`tests/fuzz/make_seeds.py`).

`scripts/fuzz` is no test, so nothing else would notice that they cannot be made.
"""

import pytest

from dockloop.base.paths import ROOT


@pytest.fixture(scope="module")
def seeds():
    with pytest.MonkeyPatch.context() as patched:
        patched.syspath_prepend(str(ROOT / "tests" / "fuzz"))
        import make_seeds

        yield make_seeds


@pytest.mark.parametrize("make", ["make_vehicles", "make_measured_slide"])
def test_documents_with_files_of_their_own_are_resolved(seeds, make, tmp_path):
    document = getattr(seeds, make)(tmp_path)
    assert {"mechanism", "chaser"} <= document.keys()
    assert str(tmp_path) not in seeds.json.dumps(document)


@pytest.mark.long  # random mechanisms are searched
def test_every_document_is_made(seeds):
    made = seeds.make_seeds()
    assert {"vehicles", "measured_slide", "scene_apda"} <= made.keys()
    assert len(made) > 30
