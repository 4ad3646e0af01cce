// Builds the parser of the command line, its help and its shell completion.
#include "cli/Grammar.h"

#include <algorithm>
#include <charconv>
#include <cstdlib>
#include <filesystem>
#include <set>
#include <span>

#include "cli/Commands.h"
#include "cli/ComposedCommands.h"
#include "cli/HistoryCommands.h"
#include "cli/RevertCommands.h"
#include "cli/SessionCommands.h"
#include "cli/Target.h"
#include "history/Moment.h"
#include "usdlive/common/core/LayerPath.h"
#include "usdlive/common/layer/SpecPath.h"

namespace usdlive::cli {

namespace {

constexpr auto kUrl =
    "URL is ws://HOST:PORT, wss://HOST:PORT (encrypted), HOST:PORT or dds://PROJECT; the\n"
    "default is USDLIVE_URL, or ws://127.0.0.1:7447. For a server with several projects use\n"
    "ws://HOST:PORT/PROJECT. The URL may name a layer: ws://HOST:PORT/LAYER.";

/// Prints the words that follow a verb in the help.
class VerbFormatter final : public CLI::Formatter {
public:
    explicit VerbFormatter(std::string words) : words_(std::move(words)) {}

    std::string make_usage(const CLI::App* app, std::string) const override {
        return "Usage: usdlive " + app->get_name() + " [OPTIONS] " + words_ + "\n";
    }
    std::string make_positionals(const CLI::App*) const override { return {}; }

private:
    std::string words_;
};

[[noreturn]] void usageError(const std::string& message) {
    throw CLI::Error("WrongWords", message, 2);
}

template <class T>
T orUsageError(Result<T> result) {
    if (!result) usageError(result.error().message);
    return std::move(*result);
}

bool isFile(const std::string& path) {
    std::error_code ignored;
    return std::filesystem::exists(path, ignored);
}

/// The number of layers that a verb accepts.
struct Layers {
    std::size_t least = 0;
    std::size_t most = std::size_t(-1);
};
constexpr Layers kNone{0, 0}, kOptional{0, 1}, kOne{1, 1}, kAny{}, kSome{1};

class Grammar {
public:
    Grammar(CLI::App& app, Command& chosen) : app_(app), chosen_(chosen) {}

    void addVerbs() {
        app_.add_subcommand("serve", "Serve the USD files of a folder; see usdlive serve --help");
        app_.add_subcommand("user", "Add and remove users of a server; see usdlive user --help");
        app_.add_subcommand("access",
                            "Print the access rules of a project; see usdlive access --help");
        app_.add_subcommand("grant",
                            "Allow edits and actions in a project; see usdlive grant --help");
        app_.add_subcommand("deny", "Deny edits and actions in a project; see usdlive deny --help");
        app_.add_subcommand("revoke", "Remove an access rule; see usdlive revoke --help");
        app_.add_subcommand("audit", "Print and check the audit log; see usdlive audit --help");
        app_.add_subcommand("backup", "Copy a project with its history; see usdlive backup --help");
        app_.add_subcommand("page", "Show a project in a browser; see usdlive page --help");
        addJoin();
        addLogin();
        addList();
        addPlain("who", "List the connected users with selection, edit target and time", "[URL]",
                 kNone, who);
        addCat("cat", "Print a layer as text", cat);
        addTree();
        addDump();
        addFlatten();
        addLog();
        addBlame();
        addDiff();
        addRevert();
        addRestore();
        addSession();
        addPlain("watch", "Print new commits until interrupted", "[URL] [LAYER]", kOptional, watch);
        addSave();
        addPlain("reload", "Replace layers by the content of their files on the server",
                 "[URL] [LAYER...]", kAny, reload);
        addUpload();
        addCheckpoint();
        addPlain("checkpoints", "List the named revisions of the project", "[URL]", kNone,
                 listCheckpoints);
        addCompact();
        addPlain("stat", "Print the used disk space of the server, by kind and by layer", "[URL]",
                 kNone, stat);
        addMute("mute", "Mute layers for everybody on the stages of a root layer", true);
        addMute("unmute", "Unmute layers for everybody", false);
        addPlain("lock", "Lock layers against edits by others", "[URL] LAYER...", kSome,
                 [](const Common& options) { return setLocked(options, true); });
        addUnlock();
        addForget();
        app_.add_subcommand("completion", "Print a completion script for bash, zsh or fish");
        app_.add_subcommand("help", "Print the help of a verb: usdlive help VERB");
    }

private:
    using Words = std::vector<std::string>;

    /// Adds a verb. When it is chosen, `read` parses the words into the options or throws
    /// usageError(), and `run` gets the options.
    template <class Options, class Read, class Run>
    CLI::App* addVerb(const std::string& name, const std::string& help, const std::string& usage,
                      std::shared_ptr<Options> options, Read read, Run run) {
        CLI::App* verb = app_.add_subcommand(name, help);
        verb->formatter(std::make_shared<VerbFormatter>(usage));
        verb->footer(std::string("\n") + kUrl);
        auto words = std::make_shared<Words>();
        verb->add_option("WORDS", *words)->type_name("");
        verb->add_option_function<std::string>(
                "--ca", [](const std::string& file) { ::setenv("USDLIVE_CA", file.c_str(), 1); },
                "Also trust servers that an authority in this file has certified;\n"
                "default: USDLIVE_CA")
            ->type_name("FILE");
        verb->callback([&chosen = chosen_, options, words, read, run] {
            read(*words, *options);
            chosen = [options, run] { return run(*options); };
        });
        return verb;
    }

    /// Adds a verb with the common options.
    template <class Options, class Read, class Run>
    CLI::App* add(const std::string& name, const std::string& help, const std::string& usage,
                  std::shared_ptr<Options> options, Read read, Run run) {
        CLI::App* verb = addVerb(name, help, usage, options, read, run);
        verb->add_option("-u,--user", options->user,
                         "Act in the name of this user; default: the user who\njoined the server, "
                         "or that of the system")
            ->type_name("NAME")
            ->envname("USDLIVE_USER");
        verb->add_flag("--json", options->json, "Print JSON");
        return verb;
    }

    /// Adds a verb that takes [URL] and layers.
    template <class Options, class Run>
    CLI::App* add(const std::string& name, const std::string& help, const std::string& usage,
                  Layers layers, std::shared_ptr<Options> options, Run run) {
        const auto read = [layers, name, usage](const Words& words, Options& into) {
            into.target = orUsageError(parseTarget(words));
            const std::size_t count = into.target.layers.size();
            if (count < layers.least)
                usageError("name a layer: usdlive " + name + " " + usage +
                           "; `usdlive ls` lists the layers");
            if (count > layers.most) usageError("too many layers: usdlive " + name + " " + usage);
        };
        return add(name, help, usage, std::move(options), read, run);
    }

    void addPlain(const std::string& name, const std::string& help, const std::string& usage,
                  Layers layers, Result<void> (*run)(const Common&)) {
        add(name, help, usage, layers, std::make_shared<Common>(), run);
    }

    void addJoin() {
        auto invitation = std::make_shared<std::string>();
        addVerb(
            "join", "Sign in at a server with an invitation", "[INVITATION]", invitation,
            [](const Words& words, std::string& into) {
                if (words.size() > 1) usageError("too many words: usdlive join [INVITATION]");
                if (!words.empty()) into = words.front();
            },
            join);
    }

    void addList() {
        auto options = std::make_shared<ListOptions>();
        auto* ls = add("ls", "List the layers of the project, or the projects at dds://", "[URL]",
                       kNone, options, list);
        auto* states = ls->add_flag("-l,--long", options->states,
                                    "Also print the state of each layer: changed, locked, open");
        ls->add_flag("--skipped", options->skipped,
                     "List the files that are not served, with the reasons, instead")
            ->excludes(states);
    }

    void addCat(const std::string& name, const std::string& help,
                Result<void> (*run)(const CatOptions&)) {
        auto options = std::make_shared<CatOptions>();
        addRevision(*add(name, help, "[URL] LAYER", kOne, options, run), *options);
    }

    void addTree() {
        auto options = std::make_shared<StageCommandOptions>();
        const auto read = [](const Words& words, StageCommandOptions& into) {
            if (into.composed) {
                chooseRoot(words, into, "tree --composed");
                into.stage.json = into.json;
                return;
            }
            into.target = orUsageError(parseTarget(words));
            if (into.target.layers.size() != 1)
                usageError("name a layer: usdlive tree [URL] LAYER; `usdlive ls` lists the layers");
        };
        auto* tree =
            add("tree", "Print the prims of a layer, or of a composed stage, with their types",
                "[URL] LAYER | --composed FILE | --composed URL LAYER", options, read,
                [](const StageCommandOptions& chosen) {
                    return chosen.composed ? treeComposed(chosen.stage) : cli::tree(chosen);
                });
        tree->add_flag(
            "--composed", options->composed,
            "Compose the stage of this layer of a project, or of a file without a server");
        tree->add_option("--session", options->stage.session, "With --composed: the session layer")
            ->type_name("FILE");
        addRevision(*tree, *options);
    }

    void addDump() {
        auto options = std::make_shared<StageCommandOptions>();
        const auto read = [](const Words& words, StageCommandOptions& into) {
            if (!into.stage.batch.empty() ? !words.empty() : !into.composed)
                usageError("name a stage: usdlive dump --composed FILE, or --composed URL LAYER");
            if (into.stage.batch.empty()) chooseRoot(words, into, "dump --composed");
        };
        auto* verb =
            addVerb("dump", "Print everything that a composed stage shows, as JSON",
                    "--composed FILE | --composed URL LAYER | --batch LIST", options, read,
                    [](const StageCommandOptions& chosen) { return dumpComposed(chosen.stage); });
        verb->add_flag(
            "--composed", options->composed,
            "Compose the stage of this layer of a project, or of a file without a server");
        verb->add_option("--session", options->stage.session, "The session layer")
            ->type_name("FILE");
        verb->add_option("--base", options->stage.base,
                         "Paths of files are relative to it; else to the folder of the file")
            ->type_name("DIR");
        verb->add_option("--fold", options->stage.fold,
                         "Of arrays with more elements only their number and a hash")
            ->capture_default_str();
        verb->add_option("--out", options->stage.out, "Write to this file")->type_name("FILE");
        addRevision(*verb, *options);
        verb->add_option("--batch", options->stage.batch,
                         "Many stages: each line of the file has ROOT, SESSION, DIR and OUT, with "
                         "tabs between them")
            ->type_name("LIST")
            ->excludes(verb->get_option("--revision"), verb->get_option("--checkpoint"));
    }

    void addFlatten() {
        auto options = std::make_shared<StageCommandOptions>();
        const auto read = [](const Words& words, StageCommandOptions& into) {
            chooseRoot(words, into, "flatten");
        };
        auto* verb = addVerb(
            "flatten", "Write what a stage shows as one layer", "FILE | URL LAYER", options, read,
            [](const StageCommandOptions& chosen) { return flattenComposed(chosen.stage); });
        verb->add_option("--session", options->stage.session, "The session layer")
            ->type_name("FILE");
        verb->add_option("--out", options->stage.out,
                         "Write to this file (.usda, .usdc); else as text")
            ->type_name("FILE");
        addRevision(*verb, *options);
    }

    static void addRevision(CLI::App& verb, CatOptions& options) {
        auto* revision =
            verb.add_option("-r,--revision", options.revision, "As it was then; 0 is now")
                ->capture_default_str();
        verb.add_option("-c,--checkpoint", options.checkpoint, "As it was at this checkpoint")
            ->excludes(revision);
    }

    /// The words name the root layer of a stage: a file, an address with a revision, or a layer of
    /// a project.
    static void chooseRoot(const Words& words, StageCommandOptions& into, const std::string& verb) {
        const std::string word = words.size() == 1 ? words.front() : std::string();
        const bool isAddress =
            word.starts_with("usdlive://") && word.find('@') != std::string::npos;
        if (isAddress || (!word.empty() && !looksLikeAddress(word)) || isFile(word)) {
            if (into.revision != 0 || !into.checkpoint.empty())
                usageError("a revision belongs to a layer of a server: usdlive " + verb +
                           " URL LAYER");
            into.stage.root = word;
            return;
        }
        auto target = orUsageError(parseTarget(words));
        if (words.empty() || target.layers.size() != 1)
            usageError("name a file or a layer: usdlive " + verb + " FILE, or usdlive " + verb +
                       " URL LAYER");
        into.stage.served = ServedRoot{std::move(target), into.revision, into.checkpoint};
    }

    /// Adds the options that choose commits, and a `path` only if `verb` has one layer.
    static void addFilter(CLI::App& verb, CommitFilter& filter) {
        verb.add_option_function<std::vector<std::string>>(
                "--by",
                [&filter](const std::vector<std::string>& names) {
                    for (const auto& name : names) filter.users.insert(UserName{name});
                },
                "Only commits of this user; may be given again")
            ->type_name("NAME")
            ->allow_extra_args(false);
        verb.add_option_function<std::string>(
                "--since",
                [&filter](const std::string& text) {
                    filter.sinceMs = orUsageError(client::momentOf(text));
                },
                "Only commits since then: 30m, 2h, 3d, or '2026-11-29 14:05'")
            ->type_name("TIME");
        verb.add_option_function<std::string>(
                "--until",
                [&filter](const std::string& text) {
                    filter.untilMs = orUsageError(client::momentOf(text));
                },
                "Only commits until then")
            ->type_name("TIME");
        verb.add_option("--label", filter.label, "Only commits with this text in their label")
            ->type_name("TEXT");
        verb.add_option("--path", filter.path,
                        "Only edits of this spec and below; it is followed through renames")
            ->type_name("PATH");
        verb.add_option_function<std::vector<std::string>>(
                "--kind",
                [&filter](const std::vector<std::string>& names) {
                    for (const auto& name : names) filter.kinds.insert(kindOrError(name));
                },
                "Only opinions of this kind, such as transform; may be given again")
            ->type_name("KIND")
            ->allow_extra_args(false);
    }
    static OpinionKind kindOrError(const std::string& name) {
        if (const auto kind = opinionKindNamed(name)) return *kind;
        std::string known;
        for (const auto one : kOpinionKindNames)
            known += (known.empty() ? "" : ", ") + std::string(one);
        usageError("'" + name + "' is no kind of opinion; there are " + known);
    }
    static void checkPath(const std::string& path, const Target& target, const std::string& usage) {
        if (path.empty()) return;
        if (target.layers.size() != 1)
            usageError("a path is one of a layer: name the layer, too: usdlive " + usage);
        if (const auto parsed = specpath::parse(path); !parsed)
            usageError("'" + path + "' is no path: " + parsed.error().message);
    }

    void addLog() {
        auto options = std::make_shared<LogOptions>();
        const auto read = [](const Words& words, LogOptions& into) {
            into.target = orUsageError(parseTarget(words));
            if (into.target.layers.size() > 1)
                usageError("too many layers: usdlive log [URL] [LAYER]");
            checkPath(into.filter.path, into.target, "log --path PATH [URL] LAYER");
        };
        auto* verb = add("log", "Print the commits, the latest at the end", "[URL] [LAYER]",
                         options, read, log);
        auto* from =
            verb->add_option("--from", options->from,
                             "Start at this revision instead of the latest commits")
                ->check(CLI::Range(std::uint64_t(1), std::uint64_t(1) << 62).description(""));
        verb->add_option("-n,--limit", options->limit, "The most commits to print")
            ->check(CLI::Range(std::uint64_t(1), std::uint64_t(1'000'000'000)).description(""))
            ->capture_default_str();
        verb->add_flag("-a,--all", options->all, "Print every edit of a commit");
        addFilter(*verb, options->filter);
        verb->get_option("--path")->excludes(from);
    }

    void addBlame() {
        auto options = std::make_shared<BlameOptions>();
        const auto read = [](Words words, BlameOptions& into) {
            const std::string usage = "usdlive blame [URL] LAYER PATH[.FIELD]";
            if (words.size() < 2) usageError("name a layer and a path: " + usage);
            into.path = takeLast(words);
            if (!into.path.starts_with('/'))
                usageError("'" + into.path + "' is no path of a spec: " + usage);
            into.target = orUsageError(parseTarget(words));
            if (into.target.layers.size() != 1) usageError("name one layer: " + usage);
        };
        auto* verb = add("blame", "Print who has made the opinions of a spec, and when",
                         "[URL] LAYER PATH[.FIELD]", options, read, blame);
        verb->add_flag("-a,--all", options->below, "Also everything below the spec");
    }

    void addDiff() {
        auto options = std::make_shared<DiffOptions>();
        const auto read = [](Words words, DiffOptions& into) {
            const std::string usage = "usdlive diff [URL] LAYER FROM [TO]";
            if (words.size() >= 3 && !(words.size() == 3 && looksLikeAddress(words.front())))
                into.to = takeLast(words);
            if (words.size() < 2) usageError("name a layer and a revision: " + usage);
            into.from = takeLast(words);
            for (const std::string& word : {into.from, into.to})
                refuseAddress(word, usage, "the URL is the first word");
            into.target = orUsageError(parseTarget(words));
            if (into.target.layers.size() != 1) usageError("name one layer: " + usage);
            checkPath(into.path, into.target, usage);
        };
        auto* verb = add("diff", "Print what has changed in a layer between two revisions",
                         "[URL] LAYER FROM [TO]", options, read, diff);
        verb->add_option("--path", options->path, "Only this spec and everything below it")
            ->type_name("PATH");
        verb->add_flag("--usda", options->asLayer, "Print the new opinions as a layer");
    }

    void addRevert() {
        auto options = std::make_shared<RevertOptions>();
        auto layer = std::make_shared<std::string>();
        const auto read = [layer](Words words, RevertOptions& into) {
            const std::string usage = "usdlive revert [URL] REVISION[-REVISION]";
            if (!words.empty() && !looksLikeAddress(words.back())) readRange(takeLast(words), into);
            into.target = serverOnly(words, usage);
            if (!layer->empty()) into.target.layers = {orUsageError(parseLayerId(*layer))};
            const CommitFilter& filter = into.filter;
            if (into.first == 0 && filter.users.empty() && filter.sinceMs < 0)
                usageError("name what to revert: " + usage + ", or --by and --since");
            checkPath(filter.path, into.target, "revert --layer LAYER --path PATH ...");
        };
        auto* verb = add("revert", "Take commits back, and leave what others have written since",
                         "[URL] [REVISION[-REVISION]]", options, read, revert);
        verb->add_option("--layer", *layer, "Only edits of this layer")->type_name("LAYER");
        addFilter(*verb, options->filter);
        verb->add_flag("--dry-run", options->dryRun, "Print what would be done, and do nothing");
    }

    static void readRange(std::string text, RevertOptions& into) {
        const auto number = [&](std::string_view digits) {
            if (digits.starts_with('#')) digits.remove_prefix(1);
            Revision value = 0;
            const auto [stop, error] =
                std::from_chars(digits.data(), digits.data() + digits.size(), value);
            if (error != std::errc() || stop != digits.data() + digits.size() || value == 0)
                usageError("'" + text + "' is no revision: write 42, or 42-45");
            return value;
        };
        const std::size_t dash = text.find('-');
        into.first = number(std::string_view(text).substr(0, dash));
        into.last = dash == std::string::npos ? into.first
                                              : number(std::string_view(text).substr(dash + 1));
        if (into.last < into.first) usageError("'" + text + "' ends before it begins");
    }

    void addRestore() {
        auto options = std::make_shared<RestoreOptions>();
        const auto read = [](Words words, RestoreOptions& into) {
            const std::string usage = "usdlive restore [URL] REVISION|CHECKPOINT [LAYER...]";
            const std::size_t at = !words.empty() && looksLikeAddress(words.front()) ? 1 : 0;
            if (words.size() <= at) usageError("name a revision: " + usage);
            into.to = words[at];
            words.erase(words.begin() + std::ptrdiff_t(at));
            for (const std::string& word : std::span(words).subspan(at))
                refuseAddress(word, usage, "the URL is the first word");
            refuseAddress(into.to, usage, "the URL is the first word");
            into.target = orUsageError(parseTarget(words));
            checkPath(into.path, into.target, "restore --path PATH [URL] REVISION LAYER");
        };
        auto* verb = add("restore", "Give layers the content of an earlier revision again",
                         "[URL] REVISION|CHECKPOINT [LAYER...]", options, read, restore);
        verb->add_option("--path", options->path, "Only this spec and everything below it")
            ->type_name("PATH");
        verb->add_flag("--dry-run", options->dryRun, "Print what would be done, and do nothing");
    }

    void addSession() {
        auto options = std::make_shared<SessionOptions>();
        auto take = std::make_shared<std::string>();
        const std::string usage =
            "usdlive session list [URL], or usdlive session "
            "create|end|restore|delete|merge|update [URL] NAME";
        const auto read = [take, usage](Words words, SessionOptions& into) {
            const std::set<std::string> verbs{"list",   "create", "end",   "restore",
                                              "delete", "merge",  "update"};
            const auto url = std::ranges::find_if(words, looksLikeAddress);
            Words server;
            if (url != words.end()) {
                server.push_back(*url);
                words.erase(url);
            }
            if (words.empty() || !verbs.contains(words.front()))
                usageError("say what to do: " + usage);
            into.verb = words.front();
            if (into.verb != "list" && words.size() < 2)
                usageError("name a live session: " + usage);
            if (words.size() > (into.verb == "list" ? 1 : 2))
                usageError("too many words: " + usage);
            if (into.verb != "list") into.name = words.back();
            refuseAddress(into.name, usage, "one URL is enough");
            into.target = serverOnly(server, usage);
            if (*take == "main") into.take = client::Take::Main;
            if (*take == "session") into.take = client::Take::Session;
            const bool hasMergeOptions = !take->empty() || into.dryRun || !into.mainPaths.empty() ||
                                         !into.sessionPaths.empty();
            if (into.verb != "merge" && into.verb != "update" && hasMergeOptions)
                usageError("only merge and update have these options: " + usage);
            if (into.verb != "merge" && into.keep)
                usageError("only merge has the option --keep: " + usage);
            if (into.verb != "create" && !into.from.empty())
                usageError("only create has the option --from: " + usage);
        };
        auto* verb = add("session", "Create, list, merge, update and end live sessions",
                         "list|create|end|restore|delete|merge|update [URL] [NAME]", options, read,
                         liveSession);
        verb->add_option("--from", options->from,
                         "create: from this revision or checkpoint of the main line")
            ->type_name("REVISION|CHECKPOINT");
        verb->add_flag("--dry-run", options->dryRun,
                       "merge, update: print what would be done, and do nothing");
        verb->add_option("--take", *take,
                         "merge, update: what counts where both have changed something:\n"
                         "main or session")
            ->check(CLI::IsMember({"main", "session"}))
            ->type_name("LINE");
        verb->add_option("--main", options->mainPaths,
                         "merge, update: take main at this spec and below it")
            ->type_name("PATH");
        verb->add_option("--session", options->sessionPaths,
                         "merge, update: take the session at this spec and below it")
            ->type_name("PATH");
        verb->add_flag("--keep", options->keep, "merge: do not end the live session");
    }

    void addUnlock() {
        auto options = std::make_shared<UnlockOptions>();
        const auto read = [](const Words& words, UnlockOptions& into) {
            into.target = orUsageError(parseTarget(words));
            if (into.all && !into.target.layers.empty())
                usageError("name layers, or say --all: usdlive unlock [URL] LAYER...");
            if (!into.all && into.target.layers.empty())
                usageError(
                    "name a layer: usdlive unlock [URL] LAYER...; `usdlive ls` lists the layers");
        };
        auto* unlock = add("unlock", "Unlock layers", "[URL] LAYER...", options, read,
                           [](const UnlockOptions& chosen) {
                               return chosen.all ? unlockAll(chosen) : setLocked(chosen, false);
                           });
        unlock->add_flag("--all", options->all,
                         "Remove all locks of layers and specs, and all mutes; for administrators");
    }

    /// Adds a verb that takes one server, without a project.
    void addForServer(const std::string& name, const std::string& help,
                      Result<void> (*run)(const ServerOnly&)) {
        const auto read = [name](const Words& words, ServerOnly& into) {
            if (words.size() != 1) usageError("name one server: usdlive " + name + " HOST:PORT");
            into.server = orUsageError(client::parseServerAddress(words.front()));
            if (into.server.dds) usageError("name a server: usdlive " + name + " HOST:PORT");
        };
        addVerb(name, help, "HOST:PORT", std::make_shared<ServerOnly>(), read, run);
    }

    void addLogin() {
        addForServer("login", "Sign in at a server with its OpenID Connect issuer", login);
    }

    void addForget() {
        addForServer("forget", "Forget the certificate and the token of a server", forget);
    }

    void addSave() {
        auto options = std::make_shared<SaveOptions>();
        auto* verb = add("save", "Write layers back to their files, on the server",
                         "[URL] [LAYER...]", kAny, options, save);
        verb->add_flag("-f,--force", options->force,
                       "Also overwrite changes that others have made to the files");
    }

    static std::string takeLast(Words& words) {
        std::string last = std::move(words.back());
        words.pop_back();
        return last;
    }
    /// Throws a usage error if the word looks like an address: a word that is missing or in the
    /// wrong place must not make a command act on the default server.
    static void refuseAddress(const std::string& word, const std::string& usage,
                              const std::string& otherwise) {
        if (looksLikeAddress(word))
            usageError("'" + word + "' looks like the address of a server: " + usage + "; " +
                       otherwise);
    }
    /// Reads the words before those that the verb has taken: [URL].
    static Target serverOnly(const Words& words, const std::string& usage) {
        Target target = orUsageError(parseTarget(words));
        if (!target.layers.empty()) usageError("too many words: " + usage);
        return target;
    }

    void addUpload() {
        const auto read = [](Words words, UploadOptions& into) {
            const std::string usage = "usdlive upload [URL] FILE PATH";
            if (words.size() < 2) usageError("name the file and its path in the project: " + usage);
            into.path = takeLast(words);
            into.file = takeLast(words);
            for (const std::string& word : {into.file, into.path})
                refuseAddress(word, usage, "./" + word + " is a file of this name");
            into.target = serverOnly(words, usage);
        };
        auto options = std::make_shared<UploadOptions>();
        auto* verb = add("upload", "Add a file to the project that is no layer, such as a texture",
                         "[URL] FILE PATH", options, read, upload);
        verb->add_flag("--overwrite", options->overwrite,
                       "Also replace a file of the project that has another content");
    }

    void addCheckpoint() {
        const auto read = [](Words words, CheckpointOptions& into) {
            const std::string usage = "usdlive checkpoint [URL] NAME";
            if (words.empty()) usageError("name the checkpoint: " + usage);
            into.name = takeLast(words);
            // After a URL, a name may look like one.
            if (words.empty() || !looksLikeAddress(words.front()))
                refuseAddress(into.name, usage,
                              "to give a checkpoint this name, write the URL before it");
            into.target = serverOnly(words, usage);
        };
        add("checkpoint", "Give the current revision a name; see cat --checkpoint", "[URL] NAME",
            std::make_shared<CheckpointOptions>(), read, createCheckpoint);
    }

    void addCompact() {
        auto options = std::make_shared<CompactOptions>();
        auto* verb =
            add("compact", "Replace old commits by the content of the layers, to save space",
                "[URL]", kNone, options, compact);
        verb->add_option("--days", options->days,
                         "Replace commits older than this; 0: all; default: the server's setting")
            ->check(CLI::Range(std::uint64_t(0), std::uint64_t(100'000)).description(""));
    }

    void addMute(const std::string& name, const std::string& help, bool muted) {
        auto root = std::make_shared<std::string>();
        const auto read = [root, name](const Words& words, MuteOptions& into) {
            into.target = orUsageError(parseTarget(words));
            auto& layers = into.target.layers;
            if (!root->empty()) {
                into.root = orUsageError(parseLayerId(*root));
            } else if (!layers.empty()) {
                into.root = layers.front();
                layers.erase(layers.begin());
            }
            if (layers.empty())
                usageError("name the root layer of the stages, and then layers: usdlive " + name +
                           " [URL] ROOT LAYER...");
        };
        auto* mute = add(name, help, "[URL] ROOT LAYER...", std::make_shared<MuteOptions>(), read,
                         [muted](const MuteOptions& chosen) { return setMuted(chosen, muted); });
        mute->add_option("--root", *root,
                         "The root layer of the stages, instead of the first layer")
            ->type_name("LAYER");
    }

    CLI::App& app_;
    Command& chosen_;
};

// Returns the number of letters to insert, remove, replace or swap with the next one.
std::size_t distance(std::string_view left, std::string_view right) {
    std::vector<std::vector<std::size_t>> cost(left.size() + 1,
                                               std::vector<std::size_t>(right.size() + 1));
    for (std::size_t i = 0; i <= left.size(); ++i)
        for (std::size_t j = 0; j <= right.size(); ++j) {
            if (i == 0 || j == 0) {
                cost[i][j] = i + j;
                continue;
            }
            cost[i][j] = std::min({cost[i - 1][j] + 1, cost[i][j - 1] + 1,
                                   cost[i - 1][j - 1] + (left[i - 1] != right[j - 1])});
            if (i > 1 && j > 1 && left[i - 1] == right[j - 2] && left[i - 2] == right[j - 1])
                cost[i][j] = std::min(cost[i][j], cost[i - 2][j - 2] + 1);
        }
    return cost[left.size()][right.size()];
}

std::string flagsOf(const CLI::App& verb) {
    std::string flags;
    for (const CLI::Option* option : verb.get_options())
        for (const std::string& name : option->get_lnames())
            flags += (flags.empty() ? "--" : " --") + name;
    return flags;
}

std::string joined(const std::vector<std::string>& words) {
    std::string text;
    for (const std::string& word : words) text += (text.empty() ? "" : " ") + word;
    return text;
}

std::string bashScript(const CLI::App& app) {
    std::string flags;
    for (const std::string& verb : verbs(app))
        flags += "        " + verb + ") flags='" + flagsOf(*app.get_subcommand(verb)) + "' ;;\n";
    // URLs are not completed, because bash splits words at colons.
    return "# usdlive completion bash >/etc/bash_completion.d/usdlive\n"
           "_usdlive() {\n"
           "    local word=${COMP_WORDS[COMP_CWORD]} flags=\n"
           "    if ((COMP_CWORD == 1)); then\n"
           "        COMPREPLY=($(compgen -W '" +
           joined(verbs(app)) +
           "' -- \"$word\"))\n"
           "        return\n"
           "    fi\n"
           "    case ${COMP_WORDS[1]} in\n" +
           flags +
           "    esac\n"
           "    if [[ $word == -* ]]; then\n"
           "        COMPREPLY=($(compgen -W \"$flags\" -- \"$word\"))\n"
           "    elif [[ ${COMP_WORDS[1]} == serve ]]; then\n"
           "        COMPREPLY=($(compgen -d -- \"$word\"))\n"
           "    elif [[ ${COMP_WORDS[1]} == help ]]; then\n"
           "        COMPREPLY=($(compgen -W '" +
           joined(verbs(app)) +
           "' -- \"$word\"))\n"
           "    else\n"
           "        local IFS=$'\\n'\n"
           "        COMPREPLY=($(compgen -W \"$(timeout 1 usdlive ls 2>/dev/null)\" -- "
           "\"$word\"))\n"
           "    fi\n"
           "}\n"
           "complete -F _usdlive usdlive\n";
}

std::string fishScript(const CLI::App& app) {
    std::string script =
        "# usdlive completion fish >~/.config/fish/completions/usdlive.fish\n"
        "complete -c usdlive -f\n";
    for (const std::string& name : verbs(app)) {
        const CLI::App& verb = *app.get_subcommand(name);
        script += "complete -c usdlive -n __fish_use_subcommand -a " + name + " -d '" +
                  verb.get_description() + "'\n";
        for (const CLI::Option* option : verb.get_options())
            for (const std::string& flag : option->get_lnames())
                script += "complete -c usdlive -n '__fish_seen_subcommand_from " + name + "' -l " +
                          flag + "\n";
    }
    return script +
           "complete -c usdlive -n 'not __fish_use_subcommand' -a "
           "'(timeout 1 usdlive ls 2>/dev/null)'\n";
}

}  // namespace

std::unique_ptr<CLI::App> createGrammar(Command& chosen) {
    auto app = std::make_unique<CLI::App>(
        "Edits OpenUSD stages together with others.\n\n"
        "  usdlive serve DIR            serve the USD files of a folder\n"
        "  usdlive ls                   the layers of the server on this machine\n"
        "  usdlive cat shot.usda        a layer as text, as it is now\n"
        "  usdlive lock HOST:7447 shot.usda\n"
        "  usdlive ls ws://HOST:7447    the projects of a server that has several\n"
        "  usdlive ls dds://            the projects that are served over DDS\n",
        "usdlive");
    app->require_subcommand(1);
    app->set_version_flag("--version", "usdlive " USDLIVE_VERSION);
    app->footer(
        "\nThe words after a verb are [URL] [LAYER...]; a word with a colon is the URL. The "
        "default\n"
        "is USDLIVE_URL, or ws://127.0.0.1:7447. USDLIVE_USER is the default of --user.\n"
        "See usdlive help VERB for the options of a verb.\n\n"
        "Exit codes: 0: success; 1: failed, completely or in part, or the output could not be\n"
        "written; 2: wrong usage.\n");
    Grammar(*app, chosen).addVerbs();
    return app;
}

std::vector<std::string> verbs(const CLI::App& app) {
    std::vector<std::string> names;
    for (const CLI::App* verb : app.get_subcommands([](const CLI::App*) { return true; }))
        names.push_back(verb->get_name());
    return names;
}

const CLI::App* findVerb(const CLI::App& app, const std::string& name) {
    const auto found =
        app.get_subcommands([&](const CLI::App* verb) { return verb->check_name(name); });
    return found.empty() ? nullptr : found.front();
}

std::string similarVerb(const CLI::App& app, std::string_view word) {
    const auto names = verbs(app);
    const auto nearest = std::ranges::min_element(
        names, {}, [&](const std::string& name) { return distance(name, word); });
    const std::size_t most = std::max<std::size_t>(2, word.size() / 3);
    return distance(*nearest, word) <= most ? *nearest : std::string();
}

std::string completionScript(const CLI::App& app, std::string_view shell) {
    if (shell == "bash") return bashScript(app);
    if (shell == "zsh")
        return "# source <(usdlive completion zsh)\n"
               "autoload -Uz bashcompinit && bashcompinit\n" +
               bashScript(app);
    if (shell == "fish") return fishScript(app);
    return {};
}

}  // namespace usdlive::cli
