"""Print the checksums of the committed results, which `reproduce` compares with its own.

python tests/verification/shipped.py > configs/results.json
"""

import json
from pathlib import Path

RESULTS = Path(__file__).parents[2] / "results"


def sums() -> dict[str, dict[str, str]]:
    """Study → its CSVs → SHA-256, as the records of the results have them."""
    records = [json.loads(path.read_text()) for path in sorted(RESULTS.glob("*.json"))]
    return {record["study"]: record["sha256"] for record in records}


if __name__ == "__main__":
    print(json.dumps(sums(), indent=1))
