// Uses every kind of member of the generated classes on one layer, and prints what they read. Tests
// do the same with the Python classes and with pxr.Usd, and compare the layers.
#include <pxr/usd/sdf/layer.h>

#include <iostream>

#include "usdlive/client/usd/stage/Stage.h"
#include "usdlive/schemas/Session.h"

using namespace usdlive;
using pxr::SdfPath;
using pxr::TfToken;

namespace {

int failures = 0;

template <class T>
T must(Result<T> result) {
    if (!result) {
        std::cerr << result.error().message << '\n';
        std::exit(1);
    }
    if constexpr (!std::is_void_v<T>) return *result;
}

template <class T>
void print(const char* what, const std::optional<T>& value) {
    std::cout << what << ' ';
    if (value)
        std::cout << *value;
    else
        std::cout << "none";
    std::cout << '\n';
}

template <class T>
void refuse(const char* what, const Result<T>& result) {
    if (result) ++failures;
    std::cout << what << ": " << (result ? "accepted" : result.error().message) << '\n';
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 2) return 2;
    const auto layer = pxr::SdfLayer::FindOrOpen(argv[1]);
    stage::Stage stage(layer);
    stage.setEditTarget(stage.editTargetFor(layer));
    const auto listed = stage.prim(SdfPath("/Listed")), other = stage.prim(SdfPath("/Other"));

    auto session = must(schemas::SessionAPI::apply(listed));
    must(schemas::SessionAPI::apply(listed));
    print("fallback", session.revision());
    print("nothing", session.project());
    must(session.setProject("ws://127.0.0.1:7447/shot"));
    must(session.setRevision(1234));
    print("revision", session.revision());
    must(must(schemas::SessionAPI::apply(other)).remove());
    must(must(schemas::SessionAPI::apply(stage.prim(SdfPath("/Explicit")))).remove());

    const auto light = must(schemas::ApprovalAPI::apply(listed, "light"));
    const auto fx = must(schemas::ApprovalAPI::apply(listed, "fx:water"));
    must(fx.remove());
    print("fallback", light.state());
    must(light.setState(TfToken("approved")));
    must(light.setState(TfToken("revise"), 5));
    print("at 7", light.state(7));

    const auto note = must(schemas::Note::define(stage, SdfPath("/Notes/first")));
    must(note.setText("too dark"));
    must(note.setAuthor("ada"));
    must(note.setFrame(pxr::SdfTimeCode(12)));
    must(note.setImage(pxr::SdfAssetPath("./drawing.png")));
    must(note.setAbout({SdfPath("/Other"), SdfPath("/Listed.usdlive:session:project")}));
    for (const auto& path : note.about()) std::cout << path << '\n';
    const auto task = must(schemas::Task::define(stage, SdfPath("/Notes/second")));
    must(task.setAssignee("bo"));
    must(task.setText("inherited"));
    print("priority", task.priority());

    const schemas::Annotation base(task.prim());
    print("through the base", base.text());
    std::cout << bool(note) << bool(task) << bool(base) << bool(schemas::Task(note.prim()))
              << bool(session) << bool(light) << bool(fx) << bool(schemas::SessionAPI(other))
              << bool(schemas::Note(stage::Prim())) << '\n';

    refuse("name of a property", schemas::ApprovalAPI::apply(listed, "state"));
    refuse("no instance", schemas::ApprovalAPI::apply(listed, ""));
    refuse("no path", schemas::Note::define(stage, SdfPath()));
    layer->SetPermissionToEdit(false);
    refuse("locked", note.setText("no"));
    refuse("locked", note.setAbout({}));
    refuse("locked", light.remove());
    layer->SetPermissionToEdit(true);
    std::cout << layer->Save() << '\n';
    return failures;
}
