"""Description of a record: a table of its topics, its events, and what could not be read."""

from datetime import UTC, datetime
from typing import Any

import numpy as np

from spidar_gym.logs.record import Record, Series
from spidar_gym.text import format_table


def described(series: Series) -> dict[str, Any]:
    """Return the facts of a series: type, number of messages, rate [Hz], largest gap [s], columns with their units."""
    times = np.sort(series.time[np.isfinite(series.time)])
    span = float(times[-1] - times[0]) if len(times) else 0.0
    return {
        "type": series.format.kind,
        "count": len(series),
        "rate_hz": (len(times) - 1) / span if span > 0.0 else None,
        "largest_gap_s": float(np.diff(times).max()) if len(times) > 1 else None,
        "columns": {name: series.unit(name) for name in series.values},
    }


def record_facts(record: Record) -> dict[str, Any]:
    """Return the facts of a record as JSON."""
    found = record.series.get("runner/events")
    return {
        "kind": record.kind,
        "duration_s": record.end - record.start if record.series else 0.0,
        "epoch": record.epoch,
        "properties": dict(record.properties),
        "topics": {topic: described(series) for topic, series in record.series.items()},
        "others": {topic: {"type": other.kind, "count": other.count} for topic, other in record.others.items()},
        "events": [] if found is None else [
            {"time": time, "text": text} for time, text in zip(found.time.tolist(), found.values["data"], strict=True)
        ],
        "warnings": list(record.warnings),
    }  # fmt: skip


def record_table(record: Record) -> str:
    """Format a record for a terminal."""
    facts = record_facts(record)
    about = ", ".join(f"{name} {value}" for name, value in record.properties.items())
    begun = f" from {datetime.fromtimestamp(record.epoch, UTC):%Y-%m-%d %H:%M:%S} UTC" if record.epoch else ""
    lines = [f"kind {record.kind}, {facts['duration_s']:.3f} s{begun}{f', {about}' if about else ''}", ""]
    rows = [("topic", "type", "messages", "rate [Hz]", "largest gap [s]")]
    columns = []
    for topic, each in facts["topics"].items():
        rate, gap = each["rate_hz"], each["largest_gap_s"]
        rows.append((topic, each["type"], str(each["count"]), _number(rate, 1), _number(gap, 3)))
        units = (f"{name} [{unit}]" if unit else name for name, unit in each["columns"].items())
        columns.append(f"{topic}: {', '.join(units)}")
    lines.append(format_table(rows, left=2))
    for title, entries in (
        ("columns [unit]", columns),
        ("other topics, not read", [f"{t}: {o['count']} messages of {o['type']}" for t, o in facts["others"].items()]),
        ("events", [f"{event['time']:.3f} s: {event['text']}" for event in facts["events"]]),
        ("damage", facts["warnings"]),
    ):
        lines += ["", f"{title}:", *(f"  {' '.join(entry.split())}" for entry in entries)] if entries else []
    return "\n".join(lines)


def _number(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"
