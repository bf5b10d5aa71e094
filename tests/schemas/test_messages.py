"""The committed generated code is that of the committed .proto."""

from importlib.resources import files
from pathlib import Path

from google.protobuf.descriptor_pb2 import FileDescriptorSet
from grpc_tools import protoc

import schemas
from schemas import messages_pb2

ROOT = Path(schemas.__file__).parent.parent


def test_generated_messages_match_their_proto(tmp_path: Path) -> None:
    output, bundled = tmp_path / "set.pb", files("grpc_tools") / "_proto"
    arguments = ["protoc", f"-I{ROOT}", f"-I{bundled}", f"--descriptor_set_out={output}", "schemas/messages.proto"]
    assert protoc.main(arguments) == 0
    (fresh,) = FileDescriptorSet.FromString(output.read_bytes()).file
    fresh.ClearField("source_code_info")
    for message in fresh.message_type:  # the compiler fills in names that the generated code leaves implicit
        for field in message.field:
            field.ClearField("json_name")
    assert fresh.SerializeToString() == messages_pb2.DESCRIPTOR.serialized_pb


def test_action_keeps_float32_exactly() -> None:
    message = messages_pb2.Action(step=3, values=[0.1, -1.0])
    assert list(messages_pb2.Action.FromString(message.SerializeToString()).values) == [0.10000000149011612, -1.0]
