"""The API's document as one page to read: no scripts, nothing from elsewhere, for people and for text search."""

from __future__ import annotations

import json
from collections.abc import Iterator
from html import escape
from typing import cast

from app.server.examples import Schema

_STYLE = """
:root{color-scheme:light dark;--ink:#181c21;--dim:#4b5560;--line:#dfe3e8;--paper:#fff;--wash:#f6f7f9;--accent:#1f5cbf}
@media(prefers-color-scheme:dark){:root{--ink:#e7eaee;--dim:#a9b3bf;--line:#2c333c;--paper:#101317;--wash:#171b20;
--accent:#7fb0ff}}
body{margin:0;background:var(--paper);color:var(--ink);font:15px/1.5 system-ui,sans-serif}
main,nav{max-width:60rem;margin:0 auto;padding:0 1.5rem}main{padding-bottom:4rem}
h1{font-size:1.7rem;margin:2rem 0 .5rem}
h2{margin:2.5rem 0 .25rem;font-size:1.25rem;border-top:1px solid var(--line);padding-top:1.2rem}
h3{font:600 .95rem ui-monospace,monospace;margin:1.6rem 0 .2rem;overflow-wrap:anywhere}
h3 b{display:inline-block;min-width:4.2rem;color:var(--accent)}
a{color:var(--accent)}p{margin:.3rem 0}.dim,dd{color:var(--dim)}code,pre{font:.85rem ui-monospace,monospace}
pre{background:var(--wash);border:1px solid var(--line);border-radius:6px;padding:.6rem .8rem;overflow:auto;max-height:22rem}
dl{margin:.4rem 0;display:grid;grid-template-columns:max-content 1fr;gap:.1rem 1rem}dd{margin:0}
summary{cursor:pointer;color:var(--dim);margin:.3rem 0}nav{padding-top:1rem}nav a{margin-right:1rem}
"""


def render(document: Schema) -> str:
    """The page."""
    info = cast("dict[str, str]", document["info"])
    tags = cast("list[dict[str, str]]", document["tags"])
    links = " ".join(f'<a href="#{tag["name"]}">{tag["name"]}</a>' for tag in tags)
    body = "".join(part for tag in tags for part in _section(document, tag))
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(info["title"])} API</title>'
        f'<meta name="viewport" content="width=device-width"><style>{_STYLE}</style></head><body>'
        f'<nav aria-label="Parts">{links}</nav><main><h1>{escape(info["title"])} API '
        f'<span class="dim">{escape(info["version"])}</span></h1>{_paragraphs(info["description"])}'
        f'<p>For programs: <a href="/api/openapi.json">/api/openapi.json</a> (OpenAPI).</p>{body}</main></body></html>'
    )


def _section(document: Schema, tag: dict[str, str]) -> Iterator[str]:
    yield f'<h2 id="{tag["name"]}">{tag["name"].capitalize()}</h2><p class="dim">{escape(tag["description"])}</p>'
    for path, operations in cast("dict[str, dict[str, Schema]]", document["paths"]).items():
        for method, operation in operations.items():
            if tag["name"] in cast("list[str]", operation.get("tags", [])):
                yield from _operation(method, path, operation)


def _operation(method: str, path: str, operation: Schema) -> Iterator[str]:
    yield f'<h3 id="{operation["operationId"]}"><b>{method.upper()}</b>{escape(path)}</h3>'
    yield _paragraphs(str(operation.get("description", "")))
    parameters = cast("list[Schema]", operation.get("parameters", []))
    if parameters:
        rows = "".join(
            f"<dt><code>{escape(str(one['name']))}</code></dt>"
            f"<dd>{escape(str(one.get('description', '')))} ({escape(str(one['in']))})</dd>"
            for one in parameters
        )
        yield f"<dl>{rows}</dl>"
    yield from _content("Body", cast(Schema, operation.get("requestBody", {})), opened=True)
    for status, response in cast("dict[str, Schema]", operation["responses"]).items():
        if status != "default":
            yield from _content(f"Answer {status}", response, opened=False)


def _content(title: str, part: Schema, *, opened: bool) -> Iterator[str]:
    for kind, media in cast("dict[str, Schema]", part.get("content", {})).items():
        examples = cast("dict[str, dict[str, object]]", media.get("examples", {}))
        if not examples:
            yield f'<p class="dim">{title}: {escape(kind)}</p>'
            continue
        shown = "".join(
            f"<pre>{escape(json.dumps(one['value'], indent=1, ensure_ascii=False))}</pre>"
            if opened and len(examples) == 1
            else f"<details><summary>{escape(name)}</summary><pre>"
            f"{escape(json.dumps(one['value'], indent=1, ensure_ascii=False))}</pre></details>"
            for name, one in examples.items()
        )
        yield f'<p class="dim">{title}: {escape(kind)}</p>{shown}'


def _paragraphs(text: str) -> str:
    """Text with blank lines between paragraphs and `code` in backticks."""
    made = []
    for paragraph in text.strip().split("\n\n"):
        pieces = escape(paragraph).split("`")
        made.append("<p>" + "".join(f"<code>{p}</code>" if i % 2 else p for i, p in enumerate(pieces)) + "</p>")
    return "".join(made)
