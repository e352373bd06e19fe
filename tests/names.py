"""Plan folders in which something has another name."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path


def renamed(compiled: Path, out: Path, old: str, new: str) -> Path:
    """Return a copy of a plan folder in which a part has another name."""
    copy = Path(shutil.copytree(compiled, out / "named.plan"))
    said = json.dumps(new)[1:-1]
    files = [copy / "plan.json", copy / "world.json", *copy.glob("evidence/*.json")]
    for path in files:
        text = path.read_text(encoding="utf-8")
        text = re.sub(rf'(?<=["(. ]){old}(?=[". >])', lambda _: said, text)
        path.write_text(text, encoding="utf-8")
    return copy
