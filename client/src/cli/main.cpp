// The command line tool `usdlive`.

#include <unistd.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <iostream>
#include <string_view>

#include "cli/Commands.h"
#include "cli/Grammar.h"
#include "cli/StandardOutput.h"
#include "cli/Terminal.h"
#include "usdlive/common/core/StandardDescriptors.h"

using namespace usdlive;

namespace {

constexpr int kFailed = 1;
constexpr int kUsageError = 2;

int failed(const std::string& message, int code = kFailed) {
    std::cout.flush();
    std::cerr << cli::Palette::of(STDERR_FILENO).paint("usdlive:", cli::Colour::Red) << " "
              << message << "\n";
    return code;
}

int unknownVerb(const CLI::App& app, const std::string& word) {
    const std::string similar = cli::similarVerb(app, word);
    return failed("unknown command: " + word + ". " +
                      (similar.empty() ? "`usdlive --help` lists the commands"
                                       : "Did you mean `usdlive " + similar + "`?"),
                  kUsageError);
}

// usdlive help [VERB]
int help(const CLI::App& app, int argc, char** argv) {
    if (argc < 3) {
        std::cout << app.help();
        return 0;
    }
    const CLI::App* verb = cli::findVerb(app, argv[2]);
    if (!verb) return unknownVerb(app, argv[2]);
    std::cout << verb->help();
    return 0;
}

// usdlive completion SHELL
int completion(const CLI::App& app, int argc, char** argv) {
    const std::string script = argc == 3 ? cli::completionScript(app, argv[2]) : "";
    if (script.empty())
        return failed("name a shell: usdlive completion bash, zsh or fish", kUsageError);
    std::cout << script;
    return 0;
}

/// Returns whether another program runs the verb: `usdlive-server`, or Python for `page`.
bool isOfOther(std::string_view verb) {
    static constexpr std::array kVerbs{"serve",  "user",  "access", "grant", "deny",
                                       "revoke", "audit", "backup", "page"};
    return std::ranges::find(kVerbs, verb) != kVerbs.end();
}

/// Replaces this process by another program, which parses its own options, including --help.
/// Returns why it cannot.
Error runOther(char** words) {
    return std::string_view(words[0]) == "page" ? cli::runPage(words) : cli::runServer(words);
}

int run(int argc, char** argv) {
    cli::Command chosen;
    const auto app = cli::createGrammar(chosen);
    const std::string_view verb = argc > 1 ? argv[1] : "--help";
    if (isOfOther(verb)) return failed(runOther(argv + 1).message);
    if (verb == "help" && argc == 3 && isOfOther(argv[2])) {
        char* words[] = {argv[2], const_cast<char*>("--help"), nullptr};
        return failed(runOther(words).message);
    }
    if (argc == 1) {
        std::cerr << app->help();
        return kUsageError;
    }
    if (verb == "help") return help(*app, argc, argv);
    if (verb == "completion") return completion(*app, argc, argv);
    if (!verb.starts_with('-') && !cli::findVerb(*app, argv[1])) return unknownVerb(*app, argv[1]);
    try {
        app->parse(argc, argv);
    } catch (const CLI::Success& asked) {
        return app->exit(asked);
    } catch (const CLI::Error& error) {
        return failed(std::string(error.what()) + ". `usdlive help" +
                          (verb.starts_with('-') ? "" : " " + std::string(verb)) +
                          "` explains the usage",
                      kUsageError);
    }
    const auto done = chosen();
    return done ? 0 : failed(done.error().message);
}

}  // namespace

int main(int argc, char** argv) {
    reserveStandardDescriptors();
    // A pipe that is closed is an error of write(), which does not end the work on the server.
    std::signal(SIGPIPE, SIG_IGN);
    cli::StandardOutput output;
    const int code = run(argc, argv);
    const auto written = output.finish();
    return written ? code : failed(written.error().message);
}
