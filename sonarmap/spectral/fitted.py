"""The numbers that were fitted to recorded evidence: one table, which `sonarmap reproduce confidence --write` makes."""

import json
from pathlib import Path
from typing import Any

TABLE = Path(__file__).with_suffix(".json")
FITTED: dict[str, Any] = json.loads(TABLE.read_text(encoding="utf-8"))
