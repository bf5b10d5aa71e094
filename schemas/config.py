"""Base of every configuration model."""

from pydantic import BaseModel, ConfigDict


class Config(BaseModel):
    """Immutable; an unknown key is an error; numbers must be finite."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
