import datetime
from collections.abc import Iterable as _Iterable
from collections.abc import Mapping as _Mapping
from typing import ClassVar as _ClassVar

from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from google.protobuf import timestamp_pb2 as _timestamp_pb2
from google.protobuf.internal import containers as _containers

DESCRIPTOR: _descriptor.FileDescriptor

class Action(_message.Message):
    __slots__ = ("step", "timestamp", "values")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    VALUES_FIELD_NUMBER: _ClassVar[int]
    timestamp: _timestamp_pb2.Timestamp
    step: int
    values: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, timestamp: datetime.datetime | _timestamp_pb2.Timestamp | _Mapping | None = ..., step: int | None = ..., values: _Iterable[float] | None = ...) -> None: ...

class SimState(_message.Message):
    __slots__ = ("integration_state", "qpos", "step", "timestamp")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    INTEGRATION_STATE_FIELD_NUMBER: _ClassVar[int]
    QPOS_FIELD_NUMBER: _ClassVar[int]
    timestamp: _timestamp_pb2.Timestamp
    step: int
    integration_state: _containers.RepeatedScalarFieldContainer[float]
    qpos: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, timestamp: datetime.datetime | _timestamp_pb2.Timestamp | _Mapping | None = ..., step: int | None = ..., integration_state: _Iterable[float] | None = ..., qpos: _Iterable[float] | None = ...) -> None: ...
