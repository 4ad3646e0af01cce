#include <CLI/CLI.hpp>
#include <functional>
#include <iostream>
#include <string_view>

#include "Commands.h"

using namespace usdlive;

namespace {

constexpr auto kUrlHelp = "The server, ws://HOST:PORT";
constexpr auto kLayerUrlHelp = "The layer, ws://HOST:PORT/LAYER";
constexpr auto kDefaultUrl = "ws://127.0.0.1:7447";

int tell(const Error& error) {
    std::cerr << "usdlive: " << error.message << "\n";
    return 1;
}

// What was chosen on the command line; empty when there was nothing to choose.
using Command = std::function<Result<void>()>;

void addList(CLI::App& app, Command& chosen) {
    auto* ls = app.add_subcommand("ls", "The layers of the project");
    auto url = std::make_shared<std::string>(kDefaultUrl);
    ls->add_option("URL", *url, kUrlHelp)->capture_default_str();
    ls->callback([&chosen, url] { chosen = [url] { return cli::list(*url); }; });
}

template <class Run>
void addCat(CLI::App& app, Command& chosen, const std::string& name, const std::string& help,
            Run run) {
    auto* cat = app.add_subcommand(name, help);
    auto options = std::make_shared<cli::CatOptions>();
    cat->add_option("URL", options->url, kLayerUrlHelp)->required();
    cat->add_option("-r,--revision", options->revision, "As it was then; 0 is now")
        ->capture_default_str();
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

void addSave(CLI::App& app, Command& chosen) {
    auto* save = app.add_subcommand("save", "Write layers back to their files, on the server");
    auto url = std::make_shared<std::string>();
    auto layers = std::make_shared<std::vector<std::string>>();
    save->add_option("URL", *url, kUrlHelp)->required();
    save->add_option("LAYER", *layers, "Which; none: all that have changed");
    save->callback(
        [&chosen, url, layers] { chosen = [url, layers] { return cli::save(*url, *layers); }; });
}

}  // namespace

int main(int argc, char** argv) {
    // All that follows is for the server to understand, also --help.
    if (argc > 1 && std::string_view(argv[1]) == "serve") return tell(cli::serve(argv + 1));

    CLI::App app(
        "Edits OpenUSD stages together with others.\n\n"
        "  usdlive serve DIR                          serve the USD files of a folder\n"
        "  usdlive ls                                 what the server on this machine has\n"
        "  usdlive cat ws://127.0.0.1:7447/shot.usda  a layer as text, as it is now\n",
        "usdlive");
    app.require_subcommand(1);
    app.set_version_flag("--version", USDLIVE_VERSION);
    Command chosen;
    app.add_subcommand("serve", "Serve the USD files of a folder; see usdlive serve --help");
    addList(app, chosen);
    addCat(app, chosen, "cat", "A layer as text", cli::cat);
    addCat(app, chosen, "tree", "The prims of a layer with their types", cli::tree);
    addLog(app, chosen);
    addWatch(app, chosen);
    addSave(app, chosen);
    CLI11_PARSE(app, argc, argv);

    const auto done = chosen();
    std::cout.flush();
    return done ? 0 : tell(done.error());
}
