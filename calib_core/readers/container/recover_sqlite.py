"""A ROS 2 sqlite3 file that rosbags does not open: cut, damaged or of an unusual schema, as far as it goes."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterator
from pathlib import Path
from urllib.parse import quote

from calib_core.readers.container.storage import (
    Damage,
    RawMessage,
    StorageError,
    TopicSummary,
    merged_topics,
    message_itself,
    normalised_type,
)


class SqliteRecovery:
    """Reads the messages table in its own order until the first unreadable page."""

    def __init__(self, path: Path, reason: str) -> None:
        self._path = path
        self.damages: list[Damage] = []
        self._names: dict[int, TopicSummary] = {}
        try:
            self._database = sqlite3.connect(f"file:{quote(str(path.resolve()))}?mode=ro&immutable=1", uri=True)
            # SQLite refuses a file shorter than its header says, unless the schema is declared writable.
            self._database.execute("PRAGMA writable_schema=ON")
            rows = self._database.execute("SELECT id, name, type FROM topics").fetchall()
        except sqlite3.Error as error:
            raise StorageError(str(error)) from error
        for topic_id, name, kind in rows:
            if not isinstance(topic_id, int):
                continue  # a damaged page: the row is read, its columns are not what they were
            self._names[int(topic_id)] = TopicSummary(str(name), normalised_type(str(kind)), 0, "cdr")
        counts: dict[int, int] = {}
        self.start_ns, self.end_ns = 1 << 62, 0
        complete = True
        try:
            for topic_id, time_ns in self._database.execute("SELECT topic_id, timestamp FROM messages ORDER BY id"):
                counts[int(topic_id)] = counts.get(int(topic_id), 0) + 1
                self.start_ns, self.end_ns = min(self.start_ns, int(time_ns)), max(self.end_ns, int(time_ns) + 1)
        except (sqlite3.Error, TypeError, ValueError):
            complete = False
        if not counts:
            self._database.close()
            raise StorageError(reason)
        self.topics = merged_topics(
            [TopicSummary(s.name, s.type, counts.get(i, 0), "cdr") for i, s in self._names.items()]
        )
        if not complete:
            self.damages.append(Damage(path.name, f"cut or damaged ({reason})", "cut", self.end_ns))

    def messages(self, topics: Collection[str], start_ns: int | None, stop_ns: int | None) -> Iterator[RawMessage]:
        low = 0 if start_ns is None else start_ns
        high = (1 << 63) - 1 if stop_ns is None else stop_ns
        wanted = {i: s.name for i, s in self._names.items() if s.name in topics}
        query = "SELECT topic_id, timestamp, data FROM messages ORDER BY id"
        last_ns = self.start_ns
        try:
            for topic_id, time_ns, payload in self._database.execute(query):
                last_ns = int(time_ns)
                if topic_id in wanted and low <= time_ns < high:
                    yield RawMessage(wanted[topic_id], int(time_ns), message_itself(bytes(payload)))
        except (sqlite3.Error, TypeError, ValueError) as error:
            # On opening, stamps alone were read: what pages of points lack shows here.
            if not self.damages:
                self.damages.append(Damage(self._path.name, f"cut or damaged ({error})", "cut", last_ns))

    def close(self) -> None:
        self._database.close()
