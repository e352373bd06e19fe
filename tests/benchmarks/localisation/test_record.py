"""What was measured is found again, by settings and code, also after a torn write."""

from __future__ import annotations

import ast
import math
from pathlib import Path

import pytest

from benchmarks.localisation import record as localisation_record
from benchmarks.localisation.record import code_of, key_of, record, recorded


def test_results_are_found_by_their_keys(tmp_path: Path) -> None:
    path = tmp_path / "new" / "record.jsonl"
    assert recorded(path) == {}
    record(path, "a", {"rms": [1.5, 0.1]})
    record(path, "b", {"rms": []})
    record(path, "a", {"rms": [1.0]})
    assert recorded(path) == {"a": {"rms": [1.0]}, "b": {"rms": []}}


def test_a_line_torn_by_a_stop_is_passed_over_and_replaced(tmp_path: Path) -> None:
    path = tmp_path / "record.jsonl"
    record(path, "a", {"rms": 1})
    whole = path.read_text(encoding="utf-8")
    path.write_text(whole + '{"key": "b", "va', encoding="utf-8")
    assert recorded(path) == {"a": {"rms": 1}}
    record(path, "c", {"rms": 3})
    assert recorded(path) == {"a": {"rms": 1}, "c": {"rms": 3}}
    with pytest.raises(ValueError, match="JSON"):
        record(path, "d", {"rms": math.nan})
    assert recorded(path) == {"a": {"rms": 1}, "c": {"rms": 3}}


def test_a_key_tells_settings_and_code_apart() -> None:
    keys = [key_of({"z_um": z}, code) for z in (0.0, 5.0) for code in ("x", "y")]
    assert len(set(keys)) == 4
    assert key_of({"a": 1, "b": 2}, "x") == key_of({"b": 2, "a": 1}, "x")


def test_code_is_that_of_a_module_and_of_all_it_imports(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(localisation_record, "ROOT", tmp_path)
    (tmp_path / "top.py").write_text("import math\nfrom low import part\n")
    (tmp_path / "low").mkdir()
    (tmp_path / "low" / "__init__.py").write_text('"""Low."""\n')
    part = tmp_path / "low" / "part.py"
    part.write_text('"""A part."""\n\n\ndef two():\n    """Two."""\n    return 2\n')
    before = code_of("top")
    part.write_text("def two():  # as before\n    return 2\n")
    assert code_of("top") == before
    part.write_text("def two():\n    return 3\n")
    assert code_of("top") != before
    with pytest.raises(ValueError, match="no module gone"):
        code_of("gone")


def test_the_fit_s_code_is_among_what_its_results_depend_on() -> None:
    tree = ast.parse("def measure():\n    return 1\n")
    assert ast.dump(localisation_record._bare(tree)) == ast.dump(tree)
    alone = code_of("microplan.featuresel.routines.template.otsu")
    assert alone != code_of(
        "microplan.featuresel.routines.template.otsu",
        "microplan.featuresel.routines.likelihood.likelihood",
    )
