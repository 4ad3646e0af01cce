// Tests what signed-in users may do (AC3, AC4, AC6).
#include <gtest/gtest.h>

#include "FakeHost.h"

namespace usdlive::server::projecttest {
namespace {

class ProjectAccess : public ::testing::Test {
protected:
    static constexpr SessionId kViewer = 1, kReviewer = 2, kEditor = 3, kAdmin = 4;

    void SetUp() override {
        world.start();
        for (const auto& [session, role] : {std::pair(kViewer, Role::Viewer),
                                            {kReviewer, Role::Reviewer},
                                            {kEditor, Role::Editor},
                                            {kAdmin, Role::Admin}})
            join(session, role);
        world.receive(kEditor, ControlMessage(OpenLayer{1, {"a.usda"}, 0}));
        world.load();
        world.host.sent.clear();
    }
    /// Sets a field of a prim.
    static Edit note(const std::string& path) {
        return {{"a.usda"}, {path, {}}, SetField{"comment", {}, doubleValue(1), {}}};
    }
    static SignedIn user(SessionId session, Role role) {
        return {{"user" + std::to_string(session)}, role, "token" + std::to_string(session)};
    }
    void join(SessionId session, Role role) {
        world.project->connected(session, user(session, role));
        world.receive(session, ControlMessage(world.hello(session)));
        welcomes[session] = world.nextControl<Welcome>(session);
        world.host.sent[session].clear();
    }
    /// Returns how a session of the user ends that says this client id; nothing if it is welcomed.
    std::optional<Error> refusalAs(SessionId session, SignedIn who, const std::string& client) {
        world.project->connected(session, who);
        Hello hello = world.hello(session);
        hello.user = who.user;
        hello.client = {client};
        world.receive(session, ControlMessage(hello));
        if (!world.host.closed.contains(session)) return std::nullopt;
        return toError(world.nextControl<ErrorMessage>(session));
    }
    void setRules(const std::string& list) {
        auto rules = AccessRules::parse(R"({"format": 1, "rules": [)" + list + "]}");
        if (!rules) throw std::runtime_error(rules.error().message);
        world.project->setRules(std::make_shared<const AccessRules>(std::move(*rules)));
    }
    /// Returns the code and the message of the refusal; nothing if the transaction was committed.
    std::optional<Error> refusal(SessionId session, std::vector<Edit> edits) {
        world.host.sent.clear();
        world.submit(session, ++sequences[session], std::move(edits), 0);
        world.store();
        const auto frame = world.next(session);
        const auto* refused = std::get_if<RefusalFrame>(&frame);
        return refused ? std::optional(refused->error) : std::nullopt;
    }
    void expectForbidden(SessionId session, std::vector<Edit> edits, const std::string& why) {
        const auto error = refusal(session, std::move(edits));
        ASSERT_TRUE(error);
        EXPECT_EQ(error->code, ErrorCode::Forbidden);
        EXPECT_NE(error->message.find(why), std::string::npos) << error->message;
    }
    std::optional<Error> errorOf(SessionId session, const ControlMessage& request) {
        world.host.sent.clear();
        world.receive(session, request);
        while (!world.silent(session)) {
            const auto frame = world.next(session);
            const auto* control = std::get_if<ControlFrame>(&frame);
            const auto message = control ? decodeControl(control->json)
                                         : Result<ControlMessage>(fail(ErrorCode::Internal, ""));
            if (!message) continue;
            if (const auto* error = std::get_if<ErrorMessage>(&*message))
                return Error{*errorFromName(error->code), error->message};
        }
        return std::nullopt;
    }

    World world;
    std::map<SessionId, std::uint64_t> sequences;
    std::map<SessionId, Welcome> welcomes;
};

TEST_F(ProjectAccess, AC3TheWelcomeNamesTheRole) {
    EXPECT_EQ(welcomes[kViewer].role, "viewer");
    EXPECT_EQ(welcomes[kAdmin].role, "admin");
    EXPECT_EQ(welcomes[kEditor].administrator, false);
    EXPECT_EQ(welcomes[kAdmin].administrator, true);
}

TEST_F(ProjectAccess, AC3EachRoleMayDoMore) {
    expectForbidden(kViewer, {set("/A.x", 1)}, "user1 is a viewer here and may not edit a.usda");
    expectForbidden(kReviewer, {set("/A.x", 1)}, "role editor");
    EXPECT_FALSE(refusal(kEditor, {set("/A.x", 1)}));
    EXPECT_FALSE(refusal(kAdmin, {set("/A.x", 2)}));

    const auto isForbidden = [this](SessionId session, const ControlMessage& request) {
        const auto error = errorOf(session, request);
        return error && error->code == ErrorCode::Forbidden;
    };
    const ControlMessage make(CreateLayer{9, {"new.usda"}});
    const ControlMessage upload(UploadFile{10, "t.png", sha256({}), 0, {}});
    for (const ControlMessage& request : {make, upload}) {
        EXPECT_TRUE(isForbidden(kReviewer, request));
        EXPECT_FALSE(isForbidden(kEditor, request));
    }
    const ControlMessage checkpoint(CreateCheckpoint{11, "one"});
    EXPECT_TRUE(isForbidden(kViewer, checkpoint));
    EXPECT_FALSE(isForbidden(kReviewer, checkpoint));
    const ControlMessage compact(CompactHistory{.request = 12, .days = 0});
    EXPECT_TRUE(isForbidden(kEditor, compact));
    EXPECT_FALSE(isForbidden(kAdmin, compact));
}

TEST_F(ProjectAccess, AC3ViewersHaveNoPreviewsAndNoBigValues) {
    world.receive(kViewer, Frame(PreviewFrame{{}, 1, 0, {set("/A.x", 1)}}));
    EXPECT_TRUE(world.silent(kEditor));
    world.receive(kViewer, Frame(BlobFrame{}));
    EXPECT_EQ(world.nextControl<ErrorMessage>(kViewer).code, "forbidden");
    world.receive(kEditor, Frame(PreviewFrame{{}, 1, 0, {set("/A.x", 1)}}));
    EXPECT_FALSE(world.silent(kAdmin));
}

TEST_F(ProjectAccess, AC1NobodyActsInTheNameOfAnother) {
    const auto welcomed = [this](SessionId session, const SignedIn& proof,
                                 const std::string& claimed) -> std::string {
        world.project->connected(session, proof);
        Hello hello = world.hello(session);
        hello.user = {claimed};
        world.receive(session, ControlMessage(hello));
        const auto message = decodeControl(world.nextFrame<ControlFrame>(session).json).value();
        if (const auto* error = std::get_if<ErrorMessage>(&message)) return error->message;
        return "";
    };
    EXPECT_EQ(welcomed(11, user(5, Role::Editor), "user5"), "");
    EXPECT_EQ(welcomed(12, user(6, Role::Editor), ""), "");
    EXPECT_NE(welcomed(13, user(7, Role::Editor), "user3").find("signed in as user7"),
              std::string::npos);
    // The owner of the process may: they could read all tokens.
    EXPECT_EQ(welcomed(14, {{}, Role::Admin, "owner"}, "user3"), "");
}

TEST_F(ProjectAccess, AC4AChangedRoleEndsTheSession) {
    world.project->rolesChanged([](const SignedIn& one) {
        return one.user.value == "user3"   ? Role::None
               : one.user.value == "user4" ? Role::Viewer
                                           : one.role;
    });
    EXPECT_EQ(world.nextControl<ErrorMessage>(kEditor).code, "signInRequired");
    EXPECT_EQ(world.nextControl<ErrorMessage>(kAdmin).code, "shuttingDown");
    EXPECT_TRUE(world.silent(kViewer));
    const Revision before = world.project->durableRevision();
    world.submit(kEditor, 1, {set("/A.x", 9)}, 0);
    world.store();
    EXPECT_EQ(world.project->durableRevision(), before);
}

TEST_F(ProjectAccess, AC23ASessionEndsWithItsSignIn) {
    const auto enter = [&](SessionId session, std::int64_t end) {
        SignedIn proof = user(session, Role::Editor);
        proof.issued = IssuedSignIn{{"lighting"}, end, Role::None};
        world.project->connected(session, proof);
        world.receive(session, ControlMessage(world.hello(session)));
        (void)world.nextControl<Welcome>(session);
        world.host.sent[session].clear();
    };
    EXPECT_FALSE(world.project->endSignIns(1'000));  // nobody is signed in by an issuer
    enter(11, 1'000);
    enter(12, 1'001);
    world.host.sent.clear();
    EXPECT_TRUE(world.project->endSignIns(999));
    EXPECT_TRUE(world.silent(11) && world.silent(12));
    EXPECT_TRUE(world.project->endSignIns(1'000));
    const auto error = world.nextControl<ErrorMessage>(11);
    EXPECT_EQ(error.code, "signInRequired");
    EXPECT_NE(error.message.find("usdlive login"), std::string::npos);
    EXPECT_TRUE(world.silent(12) && world.silent(kEditor));
    const Revision before = world.project->durableRevision();
    world.submit(11, 1, {set("/A.x", 9)}, 0);
    world.store();
    EXPECT_EQ(world.project->durableRevision(), before);
    EXPECT_FALSE(world.project->endSignIns(1'001));
    EXPECT_EQ(world.nextControl<ErrorMessage>(12).code, "signInRequired");
    EXPECT_TRUE(world.silent(kEditor));
}

TEST_F(ProjectAccess, AC6GroupsOfTheIssuerGiveRights) {
    SignedIn proof = user(21, Role::Viewer);
    proof.issued = IssuedSignIn{{"lighting"}, 1'000, Role::None};
    world.project->connected(21, proof);
    world.receive(21, ControlMessage(world.hello(21)));
    ASSERT_FALSE(refusal(kAdmin, {create("/C")}));
    expectForbidden(21, {note("/C")}, "is a viewer");
    setRules(R"({"effect": "allow", "groups": ["lighting"], "paths": ["/A/**"]})");
    EXPECT_FALSE(refusal(21, {note("/A")}));
    expectForbidden(21, {note("/C")}, "no rule allows it");
    expectForbidden(kViewer, {note("/A")}, "is a viewer");
    // A denial counts for groups, too.
    setRules(R"({"effect": "deny", "groups": ["lighting"]}, {"effect": "allow"})");
    expectForbidden(21, {note("/A")}, "rule 1 denies everything to the group lighting");
}

TEST_F(ProjectAccess, AC4ATransactionThatWaitsIsRefused) {
    // The layer is not loaded yet, so the transactions wait.
    world.submit(kEditor, 1, {set("/A.x", 9, {"b.usda"})}, 0);
    world.submit(kAdmin, 1, {set("/A.x", 8, {"b.usda"})}, 0);
    world.project->rolesChanged(
        [](const SignedIn& one) { return one.user.value == "user3" ? Role::None : one.role; });
    const Revision before = world.project->durableRevision();
    world.load();
    world.store();
    // Only that of the other user is executed.
    EXPECT_EQ(world.project->durableRevision(), before + 1);
}

TEST_F(ProjectAccess, AC6RulesDecideOnTranslatedAddresses) {
    ASSERT_FALSE(refusal(kAdmin, {create("/Props"), create("/Props/Box"), create("/Sets")}));
    const Revision base = world.project->durableRevision();
    setRules(R"({"effect": "deny", "users": ["user3"], "paths": ["/Sets/**"]})");
    ASSERT_FALSE(refusal(kEditor, {note("/Props/Box")}));
    ASSERT_FALSE(
        refusal(kAdmin, {{{"a.usda"}, {"/Props/Box", {}}, MoveSpec{{"/Sets", {}}, "Box"}}}));
    // Written before the move, it arrives in /Sets.
    world.host.sent.clear();
    world.submit(kEditor, ++sequences[kEditor], {note("/Props/Box")}, base);
    world.store();
    const auto frame = world.next(kEditor);
    const auto* refused = std::get_if<RefusalFrame>(&frame);
    ASSERT_TRUE(refused);
    EXPECT_NE(refused->error.message.find("/Sets/Box of a.usda: rule 1 denies everything"),
              std::string::npos)
        << refused->error.message;
}

TEST_F(ProjectAccess, AC6ATransactionIsRefusedAsAWhole) {
    ASSERT_FALSE(refusal(kAdmin, {create("/Sets")}));
    setRules(R"({"effect": "deny", "roles": ["editor"], "paths": ["/Sets/**"]})");
    expectForbidden(kEditor, {create("/Props"), note("/Sets")}, "rule 1");
    EXPECT_FALSE(world.project->layer({"a.usda"})->has("/Props"));
    EXPECT_FALSE(refusal(kAdmin, {note("/Sets")}));
}

TEST_F(ProjectAccess, AC6NothingIsDeletedOrMovedWithWhatIsDeniedBelow) {
    ASSERT_FALSE(refusal(
        kAdmin, {create("/World"), create("/World/Props"), create("/Free"), create("/Free/Box")}));
    setRules(R"({"effect": "deny", "roles": ["editor"], "paths": ["/World/Props/**"],
                 "kinds": ["namespace"]})");
    const auto move = [](const std::string& path, const std::string& parent) -> Edit {
        return {{"a.usda"}, {path, {}}, MoveSpec{{parent, {}}, "Moved"}};
    };
    expectForbidden(kEditor, {erase("/World")}, "/World/Props");
    expectForbidden(kEditor, {move("/World", "/")}, "/World/Props");
    expectForbidden(kEditor, {move("/Free/Box", "/World/Props")}, "/World/Props/Moved");
    EXPECT_FALSE(refusal(kEditor, {note("/World/Props")}));
    EXPECT_FALSE(refusal(kEditor, {erase("/Free")}));
}

TEST_F(ProjectAccess, AC6ARuleLetsAViewerWrite) {
    ASSERT_FALSE(refusal(kAdmin, {create("/C")}));
    setRules(R"({"effect": "allow", "users": ["user1"], "kinds": ["property"],
                 "paths": ["/A/**"]})");
    EXPECT_FALSE(refusal(kViewer, {set("/A.x", 1)}));
    expectForbidden(kViewer, {note("/A")}, "no rule allows it");
    expectForbidden(kViewer, {note("/C")}, "no rule allows it");
    expectForbidden(kViewer, {create("/B")}, "user1 may not write");
    expectForbidden(kReviewer, {set("/A.x", 1)}, "is a reviewer");
}

TEST_F(ProjectAccess, AC6PreviewsFollowTheRules) {
    ASSERT_FALSE(refusal(kAdmin, {create("/A"), create("/B")}));
    setRules(R"({"effect": "deny", "users": ["user3"], "paths": ["/A/**"]})");
    world.host.sent.clear();
    world.receive(kEditor, Frame(PreviewFrame{{}, 1, 0, {set("/A.x", 1)}}));
    EXPECT_TRUE(world.silent(kAdmin));
    world.receive(kEditor, Frame(PreviewFrame{{}, 1, 0, {set("/B.x", 1)}}));
    EXPECT_FALSE(world.silent(kAdmin));
}

/// Sets or erases a key of `omni_layer` in the custom data of a layer.
Edit ofLayer(std::vector<std::string> key, std::optional<Value> value,
             const LayerId& layer = {"a.usda"}) {
    key.insert(key.begin(), "omni_layer");
    FieldPart part = DictionaryKey{std::move(key)};
    if (!value) return {layer, {"/", {}}, EraseField{"customLayerData", part}};
    return {layer, {"/", {}}, SetField{"customLayerData", part, *value, {}}};
}
std::vector<Edit> lockedBy(const std::string& user) {
    return {ofLayer({"locked_by"}, stringValue(user)), ofLayer({"locked"}, boolValue(true))};
}
const std::vector<Edit> kUnlocked{ofLayer({"locked_by"}, {}), ofLayer({"locked"}, {})};
const Edit kMuted = ofLayer({"muteness", "./b.usda"}, boolValue(true));

TEST_F(ProjectAccess, AC11RulesDecideAboutLocksAndMutes) {
    setRules(R"({"effect": "deny", "users": ["user3"], "actions": ["lock"]},
                {"effect": "allow", "users": ["user1"], "actions": ["lock"]},
                {"effect": "allow", "users": ["user2"], "actions": ["mute"]})");
    expectForbidden(kEditor, lockedBy("user3"), "rule 1 denies lock to user3");
    expectForbidden(kEditor, {ofLayer({"specs_locking", "/A"}, stringValue("user3"))}, "rule 1");
    EXPECT_FALSE(refusal(kEditor, {kMuted}));
    expectForbidden(kReviewer, lockedBy("user2"), "is a reviewer");
    EXPECT_FALSE(refusal(kReviewer, {kMuted}));
    expectForbidden(kReviewer, {note("/")}, "no rule allows it");
    // Nothing without effect is written beside a lock, either.
    expectForbidden(kReviewer, {ofLayer({"locked_by"}, stringValue("x"))}, "is a reviewer");
    EXPECT_FALSE(refusal(kViewer, lockedBy("user1")));
    EXPECT_FALSE(refusal(kViewer, kUnlocked));
    expectForbidden(kViewer, {kMuted}, "is a viewer");
    // Locks in the whole dictionary are locks, too.
    Dictionary group, all;
    group.entries.emplace("locked", boolValue(true));
    all.entries.emplace("omni_layer", group);
    const Edit whole{{"a.usda"}, {"/", {}}, SetField{"customLayerData", {}, all, {}}};
    expectForbidden(kEditor, {whole}, "user3 may not lock in a.usda: rule 1");
    group.entries.clear();
    all.entries["omni_layer"] = group;
    const Edit harmless{{"a.usda"}, {"/", {}}, SetField{"customLayerData", {}, all, {}}};
    EXPECT_FALSE(refusal(kEditor, {harmless}));
    setRules(R"({"effect": "deny", "users": ["user3"], "actions": ["mute"]})");
    ASSERT_FALSE(refusal(kAdmin, {kMuted}));
    expectForbidden(kEditor, {harmless}, "user3 may not mute layers for everybody in a.usda");
}

TEST_F(ProjectAccess, AC11ARuleLetsAUserTakeLocksOver) {
    ASSERT_FALSE(refusal(kAdmin, lockedBy("user4")));
    EXPECT_EQ(refusal(kEditor, kUnlocked)->code, ErrorCode::Locked);
    setRules(R"({"effect": "allow", "users": ["user3"], "actions": ["takeOver"]})");
    EXPECT_EQ(refusal(kEditor, {note("/A")})->code, ErrorCode::Locked);
    EXPECT_FALSE(refusal(kEditor, kUnlocked));
    EXPECT_FALSE(refusal(kEditor, {note("/")}));
    // Also locks of specs.
    ASSERT_FALSE(refusal(kAdmin, {ofLayer({"specs_locking", "/A"}, stringValue("user4"))}));
    EXPECT_FALSE(refusal(kEditor, {ofLayer({"specs_locking", "/A"}, {})}));
    // A free lock needs the right to lock, and no rule against taking over.
    ASSERT_FALSE(refusal(kAdmin, lockedBy("user4")));
    world.project->disconnected(kAdmin);
    world.host.nowMs += 16 * 60'000;
    setRules(R"({"effect": "deny", "users": ["user3"], "actions": ["takeOver"]})");
    expectForbidden(kEditor, kUnlocked, "rule 1 denies takeOver to user3");
    setRules(R"({"effect": "deny", "users": ["user3"], "actions": ["lock"]})");
    expectForbidden(kEditor, kUnlocked, "rule 1 denies lock to user3");
    setRules("");
    EXPECT_FALSE(refusal(kEditor, kUnlocked));
}

TEST_F(ProjectAccess, AC11RulesDecideAboutRequests) {
    const auto message = [this](SessionId session, const ControlMessage& request) {
        const auto error = errorOf(session, request);
        return error ? error->message : "";
    };
    setRules(R"({"effect": "deny", "users": ["user3"]},
                {"effect": "allow", "users": ["user2"], "actions": ["upload"], "layers": ["tex/*"]},
                {"effect": "allow", "users": ["user1"], "actions": ["compact"]})");
    EXPECT_EQ(message(kEditor, ControlMessage(CreateCheckpoint{11, "one"})),
              "user3 may not create the checkpoint one: rule 1 denies everything to user3");
    EXPECT_EQ(message(kEditor, ControlMessage(CreateLayer{12, {"new.usda"}})),
              "user3 may not create new.usda: rule 1 denies everything to user3");
    const auto upload = [](const char* path) {
        return ControlMessage(UploadFile{10, path, sha256({}), 0, {}});
    };
    EXPECT_EQ(message(kReviewer, upload("tex/a.png")), "");
    EXPECT_NE(message(kReviewer, upload("a.png")).find("is a reviewer"), std::string::npos);
    const ControlMessage compact(CompactHistory{.request = 12, .days = 0});
    EXPECT_EQ(message(kViewer, compact), "");
    EXPECT_NE(message(kReviewer, compact).find("is a reviewer"), std::string::npos);
    const auto saved = [&](SessionId session) {
        world.host.sent.clear();
        world.receive(session, ControlMessage(SaveLayers{20, {{"a.usda"}}, {}}));
        world.store();
        return world.silent(session) ? ""
                                     : world.nextControl<LayersSaved>(session).failed.at(0).message;
    };
    EXPECT_EQ(saved(kEditor), "user3 may not save a.usda: rule 1 denies everything to user3");
    EXPECT_NE(saved(kViewer).find("is a viewer"), std::string::npos);
}

TEST_F(ProjectAccess, AC8AnOlderClientIsSentNoRuleAboutActionsOnly) {
    setRules(R"({"effect": "deny", "actions": ["save"]},
                {"effect": "deny", "actions": ["save"], "kinds": ["schema"]})");
    const auto numbers = [this](SessionId session, std::vector<std::string> features) {
        world.project->connected(session, user(session, Role::Editor));
        Hello hello = world.hello(session);
        hello.features = std::move(features);
        world.receive(session, ControlMessage(hello));
        std::vector<std::uint64_t> sent;
        const auto welcome = world.nextControl<Welcome>(session);
        for (const SentRule& rule : *welcome.rules) sent.push_back(rule.number);
        return sent;
    };
    EXPECT_EQ(numbers(31, {"access", "actions"}), (std::vector<std::uint64_t>{1, 2}));
    EXPECT_EQ(numbers(32, {"access"}), (std::vector<std::uint64_t>{2}));
}

TEST_F(ProjectAccess, AC9AClientIdOfAnotherUserCannotBeTaken) {
    const auto refused = refusalAs(11, user(kViewer, Role::Admin), world.client(kEditor).value);
    ASSERT_TRUE(refused);
    EXPECT_EQ(refused->code, ErrorCode::InvalidArgument);
    EXPECT_NE(refused->message.find("another user"), std::string::npos);
    EXPECT_FALSE(world.host.closed.contains(kEditor)) << "its owner is not disturbed";
    // The user itself continues with it.
    EXPECT_FALSE(refusalAs(12, user(kEditor, Role::Editor), world.client(kEditor).value));
    EXPECT_TRUE(world.host.closed.contains(kEditor));
}

TEST(ProjectUserSessions, AC10AUserCannotTakeAllSessions) {
    Project::Options options;
    options.maxUserSessions = 2;
    World world(options);
    world.start();
    const auto join = [&](SessionId session, const std::string& user) {
        world.project->connected(session, SignedIn{{user}, Role::Editor, "token"});
        Hello hello = world.hello(session);
        hello.user = {user};
        world.receive(session, ControlMessage(hello));
        return !world.host.closed.contains(session);
    };
    EXPECT_TRUE(join(1, "ann"));
    EXPECT_TRUE(join(2, "ann"));
    EXPECT_FALSE(join(3, "ann"));
    EXPECT_EQ(world.nextControl<ErrorMessage>(3).code, errorName(ErrorCode::TooManySessions));
    EXPECT_TRUE(join(4, "bob"));
    world.project->disconnected(1);
    EXPECT_TRUE(join(5, "ann"));
}

}  // namespace
}  // namespace usdlive::server::projecttest
