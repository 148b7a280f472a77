"""What only measures, fits or trains; never installed. The product imports nothing of it."""

from pathlib import Path

#: Hand labels of the recordings of real rooms.
LABELS = Path(__file__).resolve().parents[1] / "labels"
