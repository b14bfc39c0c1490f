"""Pins the arrays-to-messages code against `rosbags`, an independent implementation of ROS 1."""

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from support.logs import assert_same, random_series, typestore

from spidar_gym.logs.messages import to_messages, to_series, uses_head
from spidar_gym.logs.ros1 import MessageError, decode, parse
from spidar_gym.logs.topics import FORMATS, definition, message_fields

EPOCH = 1_700_000_000


@pytest.mark.parametrize("head", [False, True])
@pytest.mark.parametrize("topic", FORMATS)
def test_every_message_is_written_as_rosbags_reads_and_writes_it(topic, head):
    if head and topic != "imu":
        return
    series = random_series(topic, np.random.default_rng(3), head=head)
    form, store = series.format, typestore(head=head)
    kind = form.kind.replace("/", "/msg/")
    messages, lost = to_messages(series, EPOCH)
    assert lost == 0
    for k, message in enumerate(messages):
        theirs = store.deserialize_ros1(message, kind)
        assert bytes(store.serialize_ros1(theirs, kind)) == message
        for column in form.columns:
            if column.name not in series.values:
                continue
            ours, found = series.values[column.name][k], list[object]()
            for leaf in column.leaves:
                for alternative in leaf.split("|"):
                    front, _, back = alternative.partition("[].")
                    parts = getattr(theirs, front, None) if back else [theirs]
                    for part in parts if back or hasattr(theirs, alternative.partition(".")[0]) else []:
                        for name in (back or alternative).split("."):
                            part = getattr(part, name)
                        found.append(part)
            if column.kind == "string":
                assert found == [ours]
                continue
            flat = np.concatenate([np.ravel(np.asarray(each, float)) for each in found])
            expected = np.ravel(np.asarray(ours, float))
            expected = expected[np.argsort(column.order)] if column.order else expected
            np.testing.assert_array_equal(flat, expected[np.isfinite(expected)], err_msg=column.name)
    received = np.rint(1e9 * series.received).astype(np.int64) + EPOCH * 10**9
    back, warnings = to_series(
        form, message_fields(form.kind, head=head), messages, received, EPOCH, list(series.values)
    )
    assert warnings == []
    assert uses_head(series) == head
    assert_same(series, back)


def test_standard_types_have_the_checksums_of_ros():
    store, ours = get_typestore(Stores.ROS1_NOETIC), typestore()
    for kind in {form.kind for form in FORMATS.values()}:
        name = kind.replace("/", "/msg/")
        if name in store.fielddefs:
            checked = get_typestore(Stores.EMPTY)
            from rosbags.typesys import get_types_from_msg

            checked.register(get_types_from_msg(definition(kind), name))
            assert checked.generate_msgdef(name)[1] == store.generate_msgdef(name)[1], kind
    assert ours.generate_msgdef("spinal/msg/FourAxisCommand")


@pytest.mark.parametrize("text", ["float64", "Unknown x", "A a\n" + "=" * 80 + "\nMSG: p/A\nA a"])
def test_definitions_that_are_not_valid_are_refused(text):
    with pytest.raises(MessageError, match="valid"):
        parse("p/B", text)


def test_damaged_messages_are_found_and_the_others_read():
    fields, rng = message_fields("sensor_msgs/JointState"), np.random.default_rng(5)
    series = random_series("joint_states", rng, 50)
    messages, _ = to_messages(series, 0)
    messages[3] = messages[3][:-5]
    messages[9] = b"\xff" * len(messages[9])
    messages[20] = b""
    groups, damaged = decode(fields, messages)
    assert damaged.tolist() == [3, 9, 20]
    assert sum(len(group.rows) for group in groups) == 47
