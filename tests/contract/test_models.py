"""Every model of the program refuses infinities and NaN: JSON can say them (1e999) and cannot keep them."""

from __future__ import annotations

import importlib
import pkgutil

from pydantic import BaseModel

import app
import calib_core


def models():
    """Every pydantic model that the program defines."""
    for package in (app, calib_core):
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if not module.name.endswith("__main__"):
                importlib.import_module(module.name)
    found, waiting = set(), [BaseModel]
    while waiting:
        below = set(waiting.pop().__subclasses__()) - found
        found |= below
        waiting += below
    return {model for model in found if model.__module__.split(".")[0] in {"app", "calib_core"}}


def test_no_model_takes_a_number_that_is_none():
    """Oracle: the models that Python knows of, whoever wrote them. Mutation: the doctor's base without allow_inf_nan."""
    every = models()
    assert len(every) > 150  # the walk has been everywhere
    lax = sorted(f"{m.__module__}.{m.__name__}" for m in every if m.model_config.get("allow_inf_nan") is not False)
    assert lax == []
