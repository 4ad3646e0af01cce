// The command line of `usdlive`: its verbs and their options.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "usdlive/common/core/Result.h"

namespace usdlive::cli {

/// The chosen command; empty before parsing.
using Command = std::function<Result<void>()>;

/// Returns the parser. Parsing sets `chosen`, which must outlive it.
[[nodiscard]] std::unique_ptr<CLI::App> createGrammar(Command& chosen);

/// Returns the verbs in the order of the help.
[[nodiscard]] std::vector<std::string> verbs(const CLI::App& app);

/// Returns the verb with that name, or nullptr.
[[nodiscard]] const CLI::App* findVerb(const CLI::App& app, const std::string& name);

/// Returns the verb most similar to `word`, or an empty text if none is similar.
[[nodiscard]] std::string similarVerb(const CLI::App& app, std::string_view word);

/// Returns a script for `shell` (bash, zsh, fish) that completes verbs, options and layers. Empty
/// for other shells.
[[nodiscard]] std::string completionScript(const CLI::App& app, std::string_view shell);

}  // namespace usdlive::cli
