// Parses the command line and the configuration file of the server.
#include "app/Options.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>

#include "usdlive/common/dds/Domain.h"
#include "usdlive/common/fetch/ServiceUrl.h"

namespace usdlive::server {

namespace {

using Json = nlohmann::json;

constexpr int kOutputError = 1;
constexpr int kUsageError = 2;
constexpr std::uint64_t kMostTransactionMib = 4'000;  // the store's records are below 4 GiB
constexpr const char* kFooter = R"(
Examples:
  usdlive serve shots/s010                    serve a folder on this machine
  usdlive serve shots/s010 --port 0           on any free port, which it prints
  usdlive serve --projects shots              serve each folder in shots as a project
  usdlive serve shots/s010 --tls auto         encrypt, with a certificate that it makes
  usdlive serve shots/s010 --config live.json {"port": 8000, "log-format": "json"}

Editors connect to the URL it prints. GET /healthz and /metrics on the same port answer over HTTP.
History and state are kept in DIR/.usdlive. SIGTERM stops it; SIGKILL loses nothing acknowledged.)";

// The placeholder for a number in the help. It also identifies options with a whole number.
constexpr const char* kNumber = "N";

/// Returns a check that names its limits in errors but not in the help.
CLI::Validator between(std::uint64_t least, std::uint64_t most) {
    return CLI::Range(least, most).description("");
}
CLI::Validator oneOf(std::vector<std::string> names) {
    return CLI::IsMember(std::move(names)).description("");
}

void addNetworkOptions(CLI::App& app, ServerOptions& options) {
    const std::string group = "Network";
    app.add_option("--host", options.host, "Address to listen at")
        ->type_name("ADDRESS")
        ->group(group);
    app.add_option("--port", options.port, "Port to listen at; 0 takes a free one")
        ->type_name(kNumber)
        ->group(group);
    app.add_option("--port-file", options.portFile,
                   "Write the port to this file when the server listens")
        ->type_name("FILE")
        ->group(group);
    app.add_flag("--page", options.page, "Also show the project in browsers: starts `usdlive page`")
        ->group(group);
    app.add_option("--page-port", options.pagePort, "Port of the page; 0 takes a free one")
        ->type_name(kNumber)
        ->group(group);
    app.add_flag("--insecure", options.insecure,
                 "Let other machines connect although nobody has to sign\n"
                 "in, or nothing is encrypted")
        ->group(group);
    app.add_option("--allow-host", options.allowedHosts,
                   "Answer requests for this host name, too; \"*\" allows all")
        ->type_name("NAME")
        ->default_str("")
        ->allow_extra_args(false)
        ->group(group);
    app.add_option("--allow-origin", options.allowedOrigins,
                   "Let web pages of this origin connect; \"*\" allows all")
        ->type_name("ORIGIN")
        ->default_str("")
        ->allow_extra_args(false)
        ->group(group);
}

void addTlsOptions(CLI::App& app, ServerOptions& options) {
    app.add_option("--tls", options.tls,
                   "Encrypt connections with this certificate and key, in\n"
                   "PEM; SIGHUP reloads them. \"auto\" makes a certificate,\n"
                   "which clients remember at their first connection")
        ->type_name("CERT KEY|auto")
        ->default_str("")
        ->expected(1, 2)
        ->group("Network");
}

/// The options of the issuer as they are written.
struct IssuerOptions {
    IssuerRules rules;
    std::string clientId, scopes = "openid email profile offline_access", role = "none";
    std::filesystem::path keysFile;
};

void addIssuerOptions(CLI::App& app, IssuerOptions& options) {
    const std::string group = "Sign-in with OpenID Connect";
    const auto add = [&](const char* name, auto& value, const char* type, const char* what) {
        return app.add_option(name, value, what)->type_name(type)->group(group);
    };
    add("--oidc-issuer", options.rules.issuer, "URL",
        "Let this issuer sign users in, beside those of `usdlive\n"
        "user`")
        ->default_str("");
    add("--oidc-audience", options.rules.audience, "ID",
        "The audience that tokens have to name: the id of the\n"
        "client that is registered for usdlive at the issuer")
        ->default_str("");
    add("--oidc-client", options.clientId, "ID",
        "The client with which `usdlive login` asks the issuer;\n"
        "default: the audience")
        ->default_str("");
    add("--oidc-scopes", options.scopes, "SCOPES", "The scopes for which it asks");
    add("--oidc-jwks", options.keysFile, "FILE",
        "The keys of the issuer, which is then not asked for them")
        ->default_str("");
    add("--oidc-user-claim", options.rules.userClaim, "CLAIM",
        "The claim with the name of the user. Take one that users\n"
        "cannot change themselves; \"email\" counts if it is verified");
    add("--oidc-groups-claim", options.rules.groupsClaim, "CLAIM",
        "The claim with the groups of the user, for access rules");
    add("--oidc-role", options.role, "ROLE",
        "The role of users of the issuer whom `usdlive user` has\n"
        "not added; \"none\" refuses them")
        ->check(oneOf({kRoleNames.begin(), kRoleNames.end()}));
}

/// Checks the options of the issuer. Error: InvalidConfiguration names one.
Result<std::optional<IssuerSettings>> issuerOf(const CLI::App& app, const IssuerOptions& options) {
    const auto wrong = [](const std::string& what) {
        return fail(ErrorCode::InvalidConfiguration, what);
    };
    const IssuerRules& rules = options.rules;
    if (rules.issuer.empty()) {
        for (const CLI::Option* one : app.get_options())
            if (one->get_name().starts_with("--oidc-") && one->count() > 0)
                return wrong(one->get_name() + " needs --oidc-issuer URL");
        return std::nullopt;
    }
    if (const auto url = fetch::parseServiceUrl(rules.issuer); !url)
        return wrong("--oidc-issuer " + rules.issuer + ": " + url.error().cause);
    if (rules.audience.empty())
        return wrong(
            "--oidc-issuer needs --oidc-audience ID: without it, tokens for any other program "
            "would let users in");
    for (const std::string& claim : {rules.userClaim, rules.groupsClaim})
        if (const auto valid = checkClaim(claim); !valid) return wrong(valid.error().message);
    return IssuerSettings{rules, *roleNamed(options.role),
                          options.clientId.empty() ? rules.audience : options.clientId,
                          options.scopes, options.keysFile};
}

/// Checks the values of --tls. In `--tls auto DIR`, DIR is not one of them.
Result<void> separateTls(ServerOptions& options) {
    if (options.tls.empty()) return {};
    if (options.tls.front() == kOwnCertificate) {
        options.folders.insert(options.folders.begin(), options.tls.begin() + 1, options.tls.end());
        options.tls.resize(1);
        return {};
    }
    if (options.tls.size() == 2) return {};
    return fail(ErrorCode::InvalidConfiguration,
                "--tls needs the files of a certificate and of its key, or \"auto\"");
}

void addDdsOptions(CLI::App& app, ServerOptions& options) {
    const std::string group = "DDS";
    app.add_flag("--dds", options.dds,
                 "Serve over DDS, too: everybody on the network\n"
                 "interface can read and edit")
        ->group(group);
    app.add_option("--dds-interface", options.ddsInterface, "The only network interface to use")
        ->type_name("NAME")
        ->group(group);
    app.add_option("--dds-domain", options.ddsDomain, "Number of the DDS domain")
        ->type_name(kNumber)
        ->check(between(0, dds::kMaxDomain))
        ->group(group);
    app.add_option("--dds-config", options.ddsConfig,
                   "A configuration file of Cyclone DDS, which has to name\n"
                   "the interface")
        ->type_name("FILE")
        ->default_str("")
        ->group(group);
    app.add_option("--dds-security", options.ddsSecurity,
                   "Identity, permissions and governance of DDS Security:\n"
                   "participants without them are refused")
        ->type_name("DIR")
        ->default_str("")
        ->group(group);
}

void addStorageOptions(CLI::App& app, ServerOptions& options) {
    const std::string group = "Storage";
    app.add_option("--durability", options.durability,
                   "An edit is acknowledged when it is on disk (sync), or\n"
                   "when the system has it (os): faster, but lost if the\n"
                   "machine itself goes down")
        ->check(oneOf({"sync", "os"}))
        ->type_name("sync|os")
        ->group(group);
    app.add_option("--min-free-mib", options.minFreeMib,
                   "Refuse edits while the disk has less free space; default:\n"
                   "512 or 2 % of it, whichever is more")
        ->type_name(kNumber)
        ->default_str("")
        ->check(between(0, 1ull << 40))
        ->group(group);
    app.add_option("--keep-unused-blobs", options.keepUnusedBlobsMinutes,
                   "Minutes before an unused big value is removed: uploaded\n"
                   "and not used, or only in history that was replaced")
        ->type_name(kNumber)
        ->check(between(0, 1'000'000))
        ->group(group);
    app.add_flag("--reload-files", options.reloadsFiles,
                 "Reload a file that another program has changed, unless\n"
                 "there are unsaved edits of its layer");
    app.add_option("--history-days", options.historyDays,
                   "Replace older commits by the content of the layers at\n"
                   "that time, but none after the oldest checkpoint; default:\n"
                   "the whole history is kept")
        ->type_name(kNumber)
        ->default_str("")
        ->check(between(0, 100'000))
        ->group(group);
}

void addLimits(CLI::App& app, ServerOptions& options) {
    const std::string group = "Limits";
    const auto add = [&](const char* name, std::uint64_t& value, std::uint64_t least,
                         std::uint64_t most, const char* what) {
        app.add_option(name, value, what)
            ->type_name(kNumber)
            ->check(between(least, most))
            ->group(group);
    };
    add("--max-frame-mib", options.maxFrameMib, 1, 2047, "Largest message from a client");
    add("--max-blob-mib", options.maxBlobMib, 1, 1 << 20,
        "Largest big value, and largest uploaded file");
    add("--max-transaction-mib", options.maxTransactionMib, 1, kMostTransactionMib,
        "Largest transaction, the edits of one frame of an editor;\n"
        "the server's memory holds it several times");
    add("--max-sessions", options.maxSessions, 1, 1'000'000, "Most clients at the same time");
    add("--max-user-sessions", options.maxUserSessions, 1, 1'000'000,
        "Most clients of one signed-in user at the same time");
    add("--max-user-layers", options.maxUserLayers, 1, 100'000'000,
        "Most layers that the clients of one user have open");
    add("--max-guests", options.maxGuests, 1, 1'000'000,
        "Most HTTP requests, and connections without a hello;\n"
        "if there are more, one that sends nothing is closed");
    add("--guest-seconds", options.guestSeconds, 1, 3'600,
        "Most time for the headers of a request, and for the\n"
        "hello of a session");
    add("--slow-reader-mib", options.slowReaderMib, 1, 1 << 20,
        "Most data that may wait for a client; a slower client\n"
        "is disconnected");
    add("--flush-interval-ms", options.flushIntervalMs, 0, 1'000,
        "Least time between two groups of commits: more time is\n"
        "less work with many editors, but more delay for them");
}

void addLockOptions(CLI::App& app, ServerOptions& options) {
    const std::string group = "Locks";
    app.add_option("--admin", options.administrators,
                   "User who may edit and unlock what others have locked")
        ->type_name("USER")
        ->default_str("")
        ->allow_extra_args(false)
        ->group(group);
    app.add_option("--lock-takeover-minutes", options.lockTakeoverMinutes,
                   "Time after which others may take the lock of a user\n"
                   "who has left")
        ->type_name(kNumber)
        ->check(between(0, 1'000'000))
        ->group(group);
}

void addLogOptions(CLI::App& app, ServerOptions& options) {
    const std::string group = "Log, on stderr";
    app.add_option("--log-level", options.logLevel, "The lowest level that is logged")
        ->check(oneOf({std::begin(kLogLevels), std::end(kLogLevels)}))
        ->type_name("debug|info|warning|error")
        ->group(group);
    app.add_option_function<std::string>(
           "--log-format",
           [&options](const std::string& format) {
               options.logFormat = format == "json" ? LogFormat::Json : LogFormat::Text;
           },
           "Lines of text, or one JSON object per line")
        ->check(oneOf({"text", "json"}))
        ->type_name("text|json")
        ->default_str("text")
        ->group(group);
}

void addOptions(CLI::App& app, ServerOptions& options, IssuerOptions& issuer, std::string& config) {
    app.option_defaults()->always_capture_default();
    app.add_option("DIR", options.folders,
                   "The folder whose .usd, .usda and .usdc files are served:\n"
                   "a project. Several are served at ws://HOST:PORT/NAME")
        ->type_name("")
        ->default_str("");
    app.add_option("--projects", options.projectsFolder,
                   "Serve each folder in this one as a project, also folders\n"
                   "that are added later")
        ->type_name("FOLDER")
        ->default_str("");
    addNetworkOptions(app, options);
    addTlsOptions(app, options);
    addIssuerOptions(app, issuer);
    addDdsOptions(app, options);
    addStorageOptions(app, options);
    addLimits(app, options);
    addLockOptions(app, options);
    addLogOptions(app, options);
    app.add_option("--config", config,
                   "A JSON file with options of these names; flags have\n"
                   "priority")
        ->type_name("FILE")
        ->configurable(false);
}

/// Returns the values of one entry as they would be written on the command line.
std::vector<std::string> textsOf(const CLI::Option& option, const std::string& name,
                                 const Json& value) {
    if (option.get_items_expected_max() > 1) {
        std::vector<std::string> texts;
        for (const Json& item : value.is_array() ? value : Json::array({value})) {
            if (!item.is_string())
                throw CLI::ConfigError("\"" + name + "\" must be a list of texts");
            texts.push_back(item.get<std::string>());
        }
        return texts;
    }
    if (option.get_type_name() == kNumber) {
        if (!value.is_number_unsigned())
            throw CLI::ConfigError("\"" + name + "\" must be a whole number");
        return {value.dump()};
    }
    if (option.get_expected_min() == 0) {
        if (!value.is_boolean()) throw CLI::ConfigError("\"" + name + "\" must be true or false");
        return {value.dump()};
    }
    if (!value.is_string()) throw CLI::ConfigError("\"" + name + "\" must be a text");
    return {value.get<std::string>()};
}

/// Sets the options from the file that are not on the command line.
void readConfig(CLI::App& app, const std::string& path) {
    std::ifstream file(path);
    if (!file) throw CLI::ConfigError("cannot be read");
    const Json config = Json::parse(file, nullptr, false);
    if (!config.is_object()) throw CLI::ConfigError("is not a JSON object");
    for (const auto& [name, value] : config.items()) {
        CLI::Option* option = app.get_option_no_throw("--" + name);
        if (!option || !option->get_configurable() || name == "help")
            throw CLI::ConfigError("there is no option \"" + name + "\"");
        const auto texts = textsOf(*option, name, value);
        if (option->count() != 0 || texts.empty()) continue;
        for (const std::string& text : texts) option->add_result(text);
        option->run_callback();
    }
}

}  // namespace

std::variant<ServerOptions, int> parseOptions(int argc, const char* const* argv) {
    ServerOptions options;
    IssuerOptions issuer;
    std::string config;
    // `usdlive serve` starts this program under this name.
    const std::string name = argc > 0 && std::string_view(argv[0]) == "usdlive serve"
                                 ? "usdlive serve"
                                 : "usdlive-server";
    CLI::App app(
        "Serves a folder of OpenUSD layers, so that many editors can edit them at the same time.",
        name);
    app.get_formatter()->column_width(44);
    app.footer(kFooter);
    app.set_version_flag("--version", name + " " USDLIVE_VERSION)->configurable(false);
    addOptions(app, options, issuer, config);
    const auto wrong = [&name](const std::string& what) {
        std::cerr << name << ": " << what << '\n';
        return kUsageError;
    };
    try {
        app.parse(argc, argv);
    } catch (const CLI::Success& asked) {
        const int code = app.exit(asked);
        if (std::cout.flush()) return code;
        std::cerr << name << ": standard output cannot be written\n";
        return kOutputError;
    } catch (const CLI::ExtrasError&) {
        const auto rest = app.remaining();
        const auto flag = std::find_if(rest.begin(), rest.end(),
                                       [](const auto& text) { return text.starts_with('-'); });
        return wrong("there is no option " + (flag == rest.end() ? rest.front() : *flag));
    } catch (const CLI::Error& error) {
        return wrong(error.what());
    }
    try {
        if (!config.empty()) readConfig(app, config);
    } catch (const CLI::Error& error) {
        return wrong(config + ": " + error.what());
    }
    if (const auto separated = separateTls(options); !separated)
        return wrong(separated.error().message);
    auto settings = issuerOf(app, issuer);
    if (!settings) return wrong(settings.error().message);
    options.issuer = std::move(*settings);
    if (options.folders.empty() && options.projectsFolder.empty())
        return wrong("name the folder to serve, or --projects FOLDER");
    if (options.page && (options.folders.size() > 1 || !options.projectsFolder.empty()))
        return wrong(
            "--page shows one project. For one of several run usdlive page ws://HOST:PORT/PROJECT");
    return options;
}

}  // namespace usdlive::server
