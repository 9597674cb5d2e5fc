"""Examples for the API's document, made from its own schemas: what is shown is what the models accept.

A field's own example wins over its default, a default over a value made up from its type. Requests show what has to be
said and what has an example; answers show everything.
"""

from __future__ import annotations

from typing import cast

from app.schemas.common import ID_EXAMPLE, ID_PATTERN

#: A schema as decoded JSON.
Schema = dict[str, object]
_DEEPEST = 8
_PATTERNS = {ID_PATTERN: ID_EXAMPLE}


class ExampleMaker:
    """Makes examples.   components: the document's named schemas."""

    def __init__(self, components: dict[str, Schema]) -> None:
        self._components = components

    def named(self, schema: Schema, *, sparse: bool) -> dict[str, object]:
        """Examples by name: one for each kind where the schema is one of several, else `example`."""
        mapping = cast(Schema, schema.get("discriminator") or {}).get("mapping")
        if isinstance(mapping, dict):
            return {kind: self.one({"$ref": target}, sparse=sparse) for kind, target in mapping.items()}
        return {"example": self.one(schema, sparse=sparse)}

    def one(self, schema: Schema, *, sparse: bool, depth: int = 0) -> object:
        """One example."""
        schema = self._resolved(schema)
        examples = schema.get("examples")
        if isinstance(examples, list) and examples:
            return examples[0]
        for key in ("const", "default"):
            if key in schema:
                return schema[key]
        enum = schema.get("enum")
        if isinstance(enum, list):
            return enum[0]
        for key in ("oneOf", "anyOf", "allOf"):
            choices = schema.get(key)
            if isinstance(choices, list) and not sparse and any(choice.get("type") == "null" for choice in choices):
                return None
            if isinstance(choices, list):
                return self.one(self._first(choices), sparse=sparse, depth=depth)
        return self._by_type(schema, sparse=sparse, depth=depth)

    def _by_type(self, schema: Schema, *, sparse: bool, depth: int) -> object:
        match schema.get("type"):
            case "object":
                return self._object(schema, sparse=sparse, depth=depth)
            case "array":
                return self._array(schema, sparse=sparse, depth=depth)
            case "string":
                return self._text(schema)
            case "integer":
                return int(cast(float, schema.get("minimum", 0)))
            case "number":
                # A number that must be above its limit is shown one above it.
                above = schema.get("exclusiveMinimum")
                return float(cast(float, schema.get("minimum", 0.0) if above is None else cast(float, above) + 1))
            case "boolean":
                return False
            case _:
                return None

    def _object(self, schema: Schema, *, sparse: bool, depth: int) -> object:
        properties = cast("dict[str, Schema]", schema.get("properties", {}))
        required = cast("list[str]", schema.get("required", []))
        wanted = {
            name: part
            for name, part in properties.items()
            if name in required or "examples" in part or "const" in part or not sparse
        }
        if depth > _DEEPEST:
            wanted = {name: part for name, part in wanted.items() if name in required}
        return {name: self.one(part, sparse=sparse, depth=depth + 1) for name, part in wanted.items()}

    def _array(self, schema: Schema, *, sparse: bool, depth: int) -> object:
        fixed = schema.get("prefixItems")
        if isinstance(fixed, list):
            return [self.one(item, sparse=sparse, depth=depth + 1) for item in fixed]
        item = schema.get("items")
        if not isinstance(item, dict) or depth > _DEEPEST:
            return []
        count = cast(int, schema.get("minItems", 1)) or 1
        return [self.one(item, sparse=sparse, depth=depth + 1) for _ in range(count)]

    def _text(self, schema: Schema) -> str:
        if schema.get("format") == "date-time":
            return "2026-03-02T09:30:00Z"
        return _PATTERNS.get(str(schema.get("pattern", "")), "text")

    def _resolved(self, schema: Schema) -> Schema:
        """The schema behind a reference; what is said beside the reference counts first."""
        target = schema.get("$ref")
        if not isinstance(target, str):
            return schema
        beside = {key: value for key, value in schema.items() if key != "$ref"}
        return {**self._components[target.rsplit("/", 1)[-1]], **beside}

    def _first(self, choices: list[Schema]) -> Schema:
        """The first choice that is not null."""
        return next((choice for choice in choices if choice.get("type") != "null"), choices[0])
