// The words that `usdlive` understands: its verbs and their options.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "usdlive/common/core/Result.h"

namespace usdlive::cli {

/// What was chosen on the command line; empty until something was parsed.
using Command = std::function<Result<void>()>;

/// The parser. Parsing sets `chosen`, which has to outlive it.
[[nodiscard]] std::unique_ptr<CLI::App> createGrammar(Command& chosen);

/// The verbs of the parser, in the order of its help.
[[nodiscard]] std::vector<std::string> verbs(const CLI::App& app);

/// The verb of that name; nullptr: there is none.
[[nodiscard]] const CLI::App* findVerb(const CLI::App& app, const std::string& name);

/// The verb that `word` was probably meant to be; empty: nothing is like it.
[[nodiscard]] std::string similarVerb(const CLI::App& app, std::string_view word);

/// A script that makes `shell` (bash, zsh, fish) complete verbs, options and layers. Empty: another
/// shell.
[[nodiscard]] std::string completionScript(const CLI::App& app, std::string_view shell);

}  // namespace usdlive::cli
