"""Parameters fitted to recorded evidence, in one table that `sonarmap reproduce confidence --write` writes."""

import json
from pathlib import Path
from typing import Any

TABLE = Path(__file__).with_suffix(".json")
FITTED: dict[str, Any] = json.loads(TABLE.read_text(encoding="utf-8"))
