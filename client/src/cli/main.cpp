#include <CLI/CLI.hpp>
#include <functional>
#include <iostream>
#include <string_view>

#include "Commands.h"

using namespace usdlive;

namespace {

constexpr auto kUrlHelp = "The server, ws://HOST:PORT or dds://PROJECT";
constexpr auto kLayerUrlHelp = "The layer, ws://HOST:PORT/LAYER or dds://PROJECT/LAYER";
constexpr auto kDefaultUrl = "ws://127.0.0.1:7447";

int tell(const Error& error) {
    std::cerr << "usdlive: " << error.message << "\n";
    return 1;
}

// What was chosen on the command line; empty when there was nothing to choose.
using Command = std::function<Result<void>()>;

void addList(CLI::App& app, Command& chosen) {
    auto* ls = app.add_subcommand("ls", "The layers of the project; of dds://, the projects");
    auto url = std::make_shared<std::string>(kDefaultUrl);
    ls->add_option("URL", *url, kUrlHelp)->capture_default_str();
    auto states = std::make_shared<bool>(false);
    ls->add_flag("-l,--long", *states,
                 "Beside each what is known: changed, locked, who has it open");
    ls->callback(
        [&chosen, url, states] { chosen = [url, states] { return cli::list(*url, *states); }; });
}

void addWho(CLI::App& app, Command& chosen) {
    auto* who = app.add_subcommand("who", "Who is there, and where");
    auto url = std::make_shared<std::string>(kDefaultUrl);
    who->add_option("URL", *url, kUrlHelp)->capture_default_str();
    who->callback([&chosen, url] { chosen = [url] { return cli::who(*url); }; });
}

template <class Run>
void addCat(CLI::App& app, Command& chosen, const std::string& name, const std::string& help,
            Run run) {
    auto* cat = app.add_subcommand(name, help);
    auto options = std::make_shared<cli::CatOptions>();
    cat->add_option("URL", options->url, kLayerUrlHelp)->required();
    auto* revision = cat->add_option("-r,--revision", options->revision, "As it was then; 0 is now")
                         ->capture_default_str();
    cat->add_option("-c,--checkpoint", options->checkpoint, "As it was at this checkpoint")
        ->excludes(revision);
    cat->callback([&chosen, options, run] { chosen = [options, run] { return run(*options); }; });
}

void addLog(CLI::App& app, Command& chosen) {
    auto* log = app.add_subcommand("log", "Who changed what when, the latest at the end");
    auto options = std::make_shared<cli::LogOptions>();
    options->url = kDefaultUrl;
    log->add_option("URL", options->url, kUrlHelp)->capture_default_str();
    log->add_option("-l,--layer", options->layer, "Only what changed this layer");
    log->add_option("--from", options->from, "From this revision on, instead of the latest");
    log->add_option("-n,--limit", options->limit, "At most so many commits")->capture_default_str();
    log->add_flag("-a,--all", options->all, "Every edit of a commit");
    log->add_flag("--json", options->json, "One JSON object a line");
    log->callback([&chosen, options] { chosen = [options] { return cli::log(*options); }; });
}

void addWatch(CLI::App& app, Command& chosen) {
    auto* watch = app.add_subcommand("watch", "Edits as they come, until interrupted");
    auto options = std::make_shared<cli::WatchOptions>();
    options->url = kDefaultUrl;
    watch->add_option("URL", options->url, kUrlHelp)->capture_default_str();
    watch->add_option("-l,--layer", options->layer, "Only what changes this layer");
    watch->add_flag("--json", options->json, "One JSON object a line");
    watch->callback([&chosen, options] { chosen = [options] { return cli::watch(*options); }; });
}

void addLock(CLI::App& app, Command& chosen, const std::string& name, const std::string& help,
             bool locked) {
    auto* lock = app.add_subcommand(name, help);
    auto url = std::make_shared<std::string>();
    lock->add_option("URL", *url, kLayerUrlHelp)->required();
    lock->callback([&chosen, url, locked] {
        chosen = [url, locked] { return cli::setLocked(*url, locked); };
    });
}

void addSave(CLI::App& app, Command& chosen) {
    auto* save = app.add_subcommand("save", "Write layers back to their files, on the server");
    auto url = std::make_shared<std::string>();
    auto layers = std::make_shared<std::vector<std::string>>();
    auto force = std::make_shared<bool>(false);
    save->add_option("URL", *url, kUrlHelp)->required();
    save->add_option("LAYER", *layers, "Which; none: all that have changed");
    save->add_flag("-f,--force", *force, "Also over what somebody else has put into the files");
    save->callback([&chosen, url, layers, force] {
        chosen = [url, layers, force] { return cli::save(*url, *layers, *force); };
    });
}

void addReload(CLI::App& app, Command& chosen) {
    auto* reload = app.add_subcommand(
        "reload", "Take what is in the files, on the server, instead of what the layers hold");
    auto url = std::make_shared<std::string>();
    auto layers = std::make_shared<std::vector<std::string>>();
    reload->add_option("URL", *url, kUrlHelp)->required();
    reload->add_option("LAYER", *layers, "Which; none: all whose files somebody else has changed");
    reload->callback(
        [&chosen, url, layers] { chosen = [url, layers] { return cli::reload(*url, *layers); }; });
}

void addCheckpoint(CLI::App& app, Command& chosen) {
    auto* checkpoint = app.add_subcommand(
        "checkpoint", "Give what the project is now a name, to find it again: cat --checkpoint");
    auto url = std::make_shared<std::string>();
    auto name = std::make_shared<std::string>();
    checkpoint->add_option("URL", *url, kUrlHelp)->required();
    checkpoint->add_option("NAME", *name, "A name that no other checkpoint has")->required();
    checkpoint->callback([&chosen, url, name] {
        chosen = [url, name] { return cli::createCheckpoint(*url, *name); };
    });
}

void addCheckpoints(CLI::App& app, Command& chosen) {
    auto* checkpoints = app.add_subcommand("checkpoints", "The named revisions of the project");
    auto url = std::make_shared<std::string>(kDefaultUrl);
    checkpoints->add_option("URL", *url, kUrlHelp)->capture_default_str();
    checkpoints->callback(
        [&chosen, url] { chosen = [url] { return cli::listCheckpoints(*url); }; });
}

void addMute(CLI::App& app, Command& chosen, const std::string& name, const std::string& help,
             bool muted) {
    auto* mute = app.add_subcommand(name, help);
    auto url = std::make_shared<std::string>();
    auto layer = std::make_shared<std::string>();
    mute->add_option("URL", *url, "The root layer of the stages: ws://HOST:PORT/ROOT")->required();
    mute->add_option("LAYER", *layer, "Which layer of the project")->required();
    mute->callback([&chosen, url, layer, muted] {
        chosen = [url, layer, muted] { return cli::setMuted(*url, *layer, muted); };
    });
}

}  // namespace

int main(int argc, char** argv) {
    // All that follows is for the server to understand, also --help.
    if (argc > 1 && std::string_view(argv[1]) == "serve") return tell(cli::serve(argv + 1));

    CLI::App app(
        "Edits OpenUSD stages together with others.\n\n"
        "  usdlive serve DIR                          serve the USD files of a folder\n"
        "  usdlive ls                                 what the server on this machine has\n"
        "  usdlive ls dds://                          the projects that are served over DDS\n"
        "  usdlive cat ws://127.0.0.1:7447/shot.usda  a layer as text, as it is now\n",
        "usdlive");
    app.require_subcommand(1);
    app.set_version_flag("--version", USDLIVE_VERSION);
    Command chosen;
    app.add_subcommand("serve", "Serve the USD files of a folder; see usdlive serve --help");
    addList(app, chosen);
    addWho(app, chosen);
    addCat(app, chosen, "cat", "A layer as text", cli::cat);
    addCat(app, chosen, "tree", "The prims of a layer with their types", cli::tree);
    addLog(app, chosen);
    addWatch(app, chosen);
    addSave(app, chosen);
    addReload(app, chosen);
    addCheckpoint(app, chosen);
    addCheckpoints(app, chosen);
    addMute(app, chosen, "mute", "Mute a layer for everybody on the stages of a root layer", true);
    addMute(app, chosen, "unmute", "End that", false);
    addLock(app, chosen, "lock", "Lock a layer: nobody else may edit it", true);
    addLock(app, chosen, "unlock", "End a layer's lock", false);
    CLI11_PARSE(app, argc, argv);

    const auto done = chosen();
    std::cout.flush();
    return done ? 0 : tell(done.error());
}
