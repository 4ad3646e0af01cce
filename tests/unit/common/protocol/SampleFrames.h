// Sample frames of each kind.
#pragma once

#include <string>
#include <vector>

#include "usdlive/common/protocol/Frame.h"

namespace usdlive {

inline Edit edit(const char* path, EditAction action, const char* layer = "shot/a.usda") {
    return {{layer}, {path, {}}, std::move(action)};
}

inline std::vector<Edit> everyKindOfEdit() {
    const Value reference = tokenValue("an item");
    FieldValue samples(TimeSamples{{{1.0, doubleValue(2)}, {2.5, doubleValue(3)}}});
    Dictionary inner{{{"a", Dictionary::Entry(doubleValue(1))}}};
    Dictionary dictionary{{{"x:y", Dictionary::Entry(inner)}}};
    ListOp list;
    list.itemType = ValueType::Token;
    list[ListName::Prepended] = {tokenValue("one"), tokenValue("two")};
    const Value blob = Value::blob(arrayOf(ValueType::Float3), sha256(asBytes("x")), 12'000'000);
    Edit created{{"b.usda"}, {".x", Creation{7, 2}}, SetField{"default", {}, blob, {}}};
    return {
        edit("/A", CreateSpec{SpecKind::Prim}),
        edit("/A.x", CreateSpec{SpecKind::Attribute}),
        edit("/A{v=}", CreateSpec{SpecKind::VariantSet}),
        edit("/A{v=one}", CreateSpec{SpecKind::Variant}),
        edit("/A.r", CreateSpec{SpecKind::Relationship}),
        edit("/A", DeleteSpec{}),
        edit("/A", MoveSpec{{"/B", {}}, "C"}),
        edit("/A", MoveSpec{{"", Creation{7, 0}}, "C"}),
        edit("/A", PlaceSpec{}),
        edit("/A", PlaceSpec{"B"}),
        edit("/A", SetField{"customData", {}, dictionary, {}}),
        edit("/A", SetField{"apiSchemas", {}, list, {}}),
        edit("/A.x", SetField{"timeSamples", {}, samples, {}}),
        edit("/A.x", SetField{"timeSamples", SampleTime{-0.5}, doubleValue(1), {}}),
        edit("/A", SetField{"customData", DictionaryKey{{"a", "b:c", ""}}, doubleValue(1), {}}),
        edit("/A", SetField{"apiSchemas",
                            ListItem{ListName::Appended, reference, tokenValue("other")},
                            {},
                            ValueType::Token}),
        edit("/A", SetField{"variantSelection", MapKey{stringValue("set")}, stringValue("one"),
                            ValueType::String}),
        edit("/A.x", EraseField{"default", {}}),
        edit("/A.x", EraseField{"timeSamples", SampleTime{1}}),
        edit("/A", EraseField{"customData", DictionaryKey{{"k"}}}),
        edit("/A", EraseField{"apiSchemas", ListItem{ListName::Deleted, reference, {}}}),
        edit("/A", EraseField{"variantSelection", MapKey{stringValue("set")}}),
        created,
    };
}

inline Commit sampleCommit() {
    Commit commit;
    commit.revision = 9;
    commit.epoch = 3;
    commit.id = {{"0123456789abcdef0123456789abcdef"}, 4};
    commit.user = {"Zoë"};
    commit.timeMs = 1'700'000'000'123;
    commit.gesture = 11;
    commit.edits = everyKindOfEdit();
    commit.dropped = {{5, ErrorCode::SpecDeleted, edit("/Gone.x", DeleteSpec{}, "c.usd")}};
    commit.previous = sha256(asBytes("before"));
    return commit;
}

inline CommitFrame sampleConflated() {
    CommitFrame frame{sampleCommit(), sha256(asBytes("after"))};
    frame.commit.conflated = 7;
    return frame;
}

/// Returns one frame of each kind.
inline std::vector<Frame> sampleFrames() {
    return {SubmitFrame{{{{"client"}, 4}, 17, 5, everyKindOfEdit()}},
            CommitFrame{sampleCommit()},
            sampleConflated(),
            RefusalFrame{4, 2, {ErrorCode::Locked, "x"}},
            PreviewFrame{{"someone"}, 3, 17, everyKindOfEdit()},
            BlobFrame{{}, 10, 0, 3, deflate(Bytes{1, 2, 3})},
            BlobFrame{{}, 10, 0, 3, deflate(Bytes{1, 2, 3}), 7},
            SnapshotFrame{5, 0, true, 3, deflate(Bytes{1, 2, 3})},
            ControlFrame{R"({"type":"logEnd","request":3})"}};
}

}  // namespace usdlive
