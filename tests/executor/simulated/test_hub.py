"""Claims about how the simulated cell is made of a file."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.simulated.cell import build_cell
from microplan.executor.simulated.hub import read_world
from microplan.schemas.codec import from_data, to_data
from microplan.schemas.files.world import LightKind, World
from tests.executor.bench import world


def in_light(kind: LightKind) -> World:
    plain = world()
    return replace(plain, optics=replace(plain.optics, light_kind=kind))


@pytest.mark.parametrize("kind", ["ring", "dark_field", "transmitted"])
def test_light_that_the_cell_does_not_show_is_refused_at_its_line(
    tmp_path: Path, kind: LightKind
) -> None:
    file = tmp_path / "world.json"
    file.write_text(json.dumps(to_data(in_light(kind)), indent=2), encoding="utf-8")
    with pytest.raises(ExecutorError, match=f"{kind} light.*coaxial") as found:
        read_world(file)
    assert found.value.code == "MP816"
    path, _, line = str(found.value.place).rpartition(":")
    assert path == str(file)
    assert f'"light_kind": "{kind}"' in file.read_text().splitlines()[int(line) - 1]
    with pytest.raises(ValueError, match=kind):
        build_cell(in_light(kind), 0)


def test_a_world_from_before_kinds_of_light_is_of_coaxial_light() -> None:
    data = to_data(world())
    del data["optics"]["light_kind"]
    assert from_data(World, data).optics.light_kind == "coaxial"


@pytest.mark.parametrize("share", [0.0, 0.8])
def test_a_world_from_before_kinds_of_light_says_that_its_lamp_is_not_coaxial(
    tmp_path: Path, share: float
) -> None:
    data = to_data(world())
    del data["optics"]["light_kind"]
    data["optics"]["lamp_share"] = share
    file = tmp_path / "world.json"
    file.write_text(json.dumps(data, indent=2), encoding="utf-8")
    if share:
        assert read_world(file).optics.light_kind == "coaxial"
        return
    with pytest.raises(ExecutorError, match=r"other light.*coaxial") as found:
        read_world(file)
    assert found.value.code == "MP816"
    line = int(str(found.value.place).rpartition(":")[2])
    assert '"lamp_share": 0.0' in file.read_text().splitlines()[line - 1]
