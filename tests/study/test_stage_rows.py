"""Stages of a construction as rows of a file: interrupted, they go on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.support.commands import command
from validation import load_case, solve
from validation.study import beside_rigid
from validation.study.beside_rigid import solve_in_stages
from validation.study.rowfile import RowFile

KEYS = {
    "assembly.voussoirs": 6,
    "block.thickness": 150.0,
    "effects.friction": 0.7,
    "stages.order": [1, 6, 2, 5, 3, 4],
    "stages.along": "normal",
}


def test_an_interrupted_construction_goes_on_with_the_same_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case, store, judged = load_case("arch", KEYS, method="rigid"), tmp_path / "x.jsonl", []
    whole = beside_rigid.Construction.stage

    def stage(self: Any, n: int, sought: float) -> Any:
        if n == 4 and len(judged) == 3:
            judged.append(0)
            raise KeyboardInterrupt
        judged.append(n)
        return whole(self, n, sought)

    monkeypatch.setattr(beside_rigid.Construction, "stage", stage)
    with pytest.raises(KeyboardInterrupt):
        solve_in_stages(case, store, lambda _: None)
    assert len(RowFile(store)) == 3
    told: list[str] = []
    answer = solve_in_stages(case, store, lambda words: told.append(str(words)))
    assert judged == [1, 2, 3, 0, 4, 5, 6]
    assert "stage 6 of 6" in told
    monkeypatch.undo()
    at_once = solve(case)
    assert [row for row in answer.table.rows if row.group != "time"] == [
        row for row in at_once.table.rows if row.group != "time"
    ]
    found, direct = answer.parts["stages"], at_once.parts["stages"]
    assert found.as_json() == direct.as_json()
    assert found[5].contacts["force"] == pytest.approx(direct[5].contacts["force"])


def test_the_table_of_stages_has_units_and_is_written(tmp_path: Path) -> None:
    settings = [
        w for k, v in KEYS.items() for w in ("--set", f"{k}={v}".replace("normal", '"normal"'))
    ]
    status, out, _ = command("mbd", "arch", *settings, "-o", str(tmp_path))
    assert status == 0
    assert "centering needed" in out
    head, *rows = (tmp_path / "stages.csv").read_text().splitlines()
    assert {"stage", "propping_N", "thrust_N", "largest_joint_force_N"} <= set(head.split(","))
    assert len(rows) == 6
    assert len(RowFile(tmp_path / "stages.jsonl")) == 6
