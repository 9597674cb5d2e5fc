"""A document that does not fit, told in words of our own: whatever a model asks of it."""

from __future__ import annotations

from typing import Annotated, Literal

import pytest
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from calib_core.validation_messages import misfit, place_of

RIGHT: dict[str, object] = {"schema": "a/1", "id": "0", "size": 1.0, "ways": [1, 2]}


class _Document(BaseModel):
    model_config = ConfigDict(extra="forbid")
    schema_: Literal["a/1"] = Field(alias="schema")
    id: Annotated[str, Field(pattern="^[0-9]$")]
    size: Annotated[float, Field(gt=0)]
    ways: Annotated[list[int], Field(max_length=2)]

    @field_validator("size")
    @classmethod
    def not_two(cls, size: float) -> float:
        if size == 2.0:
            raise ValueError("two is taken")
        return size


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"schema": "b/1"}, "it should be 'a/1', found 'b/1'"),
        ({"colour": 1}, "nothing of this name is known"),
        ({"id": "x"}, "no such thing is known, found 'x'"),
        ({"size": -1.0}, "it should be greater than 0, found -1.0"),
        ({"size": "wide"}, "it should be a valid number, unable to parse string as a number, found 'wide'"),
        ({"size": 2.0}, "two is taken"),
        ({"size": None}, "it should be a valid number"),
        ({"ways": [1, 2, 3]}, "it should have at most 2 items after validation, not 3"),
        ({"ways": "x" * 99}, "it should be a valid list"),
    ],
)
def test_what_is_wrong_is_said_in_our_words(change: dict[str, object], said: str) -> None:
    """The validation library's phrases ("Input should be", "Extra inputs are not permitted") reached people.

    Mutations: its own message; what was found left out, or told however long.
    """
    with pytest.raises(ValidationError) as wrong:
        _Document.model_validate(RIGHT | change)
    (problem,) = wrong.value.errors()
    assert misfit(problem) == said


def test_what_is_missing_is_said() -> None:
    """Mutation: "Field required"."""
    with pytest.raises(ValidationError) as wrong:
        _Document.model_validate({name: value for name, value in RIGHT.items() if name != "id"})
    assert misfit(wrong.value.errors()[0]) == "it is missing"


class _Circle(BaseModel):
    kind: Literal["circle"]


class _Square(BaseModel):
    kind: Literal["square"]


class _Drawing(BaseModel):
    shape: Annotated[_Circle | _Square, Field(discriminator="kind")] = _Circle(kind="circle")
    ways: Literal["auto", "off"] | tuple[Annotated[str, Field(max_length=3)], ...] = "auto"


@pytest.mark.parametrize(
    ("document", "said"),
    [
        ({"shape": {"kind": "line"}}, {("shape", "kind should be one of 'circle', 'square', found 'line'")}),
        ({"shape": {}}, {("shape", "kind is missing")}),
        (
            {"ways": "some"},
            {
                ("ways", "it should be 'auto' or 'off', found 'some'"),
                ("ways", "it should be a valid tuple, found 'some'"),
            },
        ),
    ],
)
def test_where_it_is_wrong_and_which_kinds_there_are_is_said_without_the_librarys_names(
    document: dict[str, object], said: set[tuple[str, str]]
) -> None:
    """Seen: "Input tag 'nope' found using 'op'", and places like literal['auto','off']. Mutations: its message; its places."""
    with pytest.raises(ValidationError) as wrong:
        _Drawing.model_validate(document)
    assert {(place_of(problem), misfit(problem)) for problem in wrong.value.errors()} == said
