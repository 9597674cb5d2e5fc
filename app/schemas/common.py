"""What every wire model shares: the strict base, the one error body, and times."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Annotated, cast

from pydantic import BaseModel, ConfigDict, Field
from pydantic.config import JsonDict

from calib_core.settings import FARTHEST_S


class WireModel(BaseModel):
    """Base of everything that crosses HTTP. Unknown keys are refused: a misspelt option must not be ignored.

    So are infinities and NaN, which JSON can say (1e999) and cannot keep: they would be read back as null.
    """

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


def described_by(model: type[BaseModel]) -> Callable[[JsonDict], None]:
    """What gives a schema's fields the descriptions that another model has for fields of the same names.

    For a `model_config` (json_schema_extra): a request that changes a record has the record's own fields, all of them optional.
    """

    def describe(schema: JsonDict) -> None:
        for name, field in cast("dict[str, JsonDict]", schema["properties"]).items():
            known = model.model_fields.get(name)
            if known is not None and known.description is not None:
                field.setdefault("description", known.description)

    return describe


#: Names of recordings, jobs and uploads: 128 random bits in hexadecimal, never anything a user typed.
ID_DIGITS = "[0-9a-f]{32}"
ID_PATTERN = f"^{ID_DIGITS}$"
ID_EXAMPLE = "5f0c6c9be0b24d9f8c1be9ad0a2f1f0e"
RecordId = Annotated[str, Field(pattern=ID_PATTERN, examples=[ID_EXAMPLE])]

#: The longest name in a request.
LONGEST_NAME = 1000
#: What a file calls something of its own, as a topic. No format has longer ones, and they are in every list of recordings.
NameInFile = Annotated[str, Field(max_length=LONGEST_NAME)]

#: Added to IMU stamps; as far as the library takes one, in a file too.
OffsetSeconds = Annotated[float, Field(ge=-FARTHEST_S, le=FARTHEST_S)]


def is_id(text: str) -> bool:
    """Whether something can be called so."""
    return re.fullmatch(ID_DIGITS, text, re.ASCII) is not None


class ErrorDetails(WireModel):
    """What a program may want to know beyond the sentence; every field is present, unused ones are empty."""

    candidates: list[str] = Field(default_factory=list, description="what could have been meant, e.g. topics that fit")
    fields: list[str] = Field(default_factory=list, description="the request's fields at fault, as dotted paths")


class ErrorFacts(WireModel):
    """A stable dotted code and one sentence for a person."""

    code: str = Field(examples=["recording.not_found"], description="stable and dotted")
    text: str = Field(
        examples=["No recording has the id 5f0c...; open the list of recordings and pick one."],
        description="one sentence for a person: what is wrong and what to do",
    )
    details: ErrorDetails | None = Field(default=None, description="more for a program; null: none")


class ErrorBody(WireModel):
    """The body of every answer whose status is 400 or above."""

    error: ErrorFacts = Field(description="what went wrong")
