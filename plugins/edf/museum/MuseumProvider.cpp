// The provider `omniMet`: departments and objects of a museum's collection, from its REST service.
//
// providerArgs:
// - dataLodLevel: 0 (default), departments; 1, also at most lod1Count objects of each; 2, also all
//   objects
// - lod1Count: 0 (default) means all
// - deferredRead: "true", the objects of a department are read when they are first needed
// - baseAddress: http[s]://host[:port][/path]; the default is USDLIVE_EDF_MUSEUM_URL (Address.h
//   says which addresses are allowed)
//
// The service has three routes below its address: /departments, /objects?departmentIds=ID,
// /objects/ID.
//
// Environment: USDLIVE_EDF_MUSEUM_URL, USDLIVE_EDF_ALLOWED_HOSTS, USDLIVE_CACHE (a folder),
// USDLIVE_CACHE_MIB, USDLIVE_EDF_CACHE ("0": answers are not cached), USDLIVE_EDF_REQUEST_SECONDS
// (15, for one answer).
#include <pxr/base/tf/getenv.h>
#include <pxr/base/tf/stringUtils.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <charconv>
#include <map>
#include <optional>
#include <set>
#include <stdexcept>

#include "AnswerCache.h"
#include "Collection.h"
#include "Fetcher.h"
#include "usdlive/edf/DataProvider.h"

namespace {

using pxr::SdfPath;
using pxr::TfToken;
using pxr::VtValue;
using usdlive::edf::EdfArguments;
using usdlive::edf::EdfDataParameters;
using usdlive::edf::IEdfSourceData;
namespace museum = usdlive::edf::museum;

// The most objects for one payload or deferred department. More are left out with a warning.
constexpr std::size_t kMaxObjects = 20'000;
constexpr std::size_t kMaxObjectBytes = 1u << 20;

struct Options {
    int level = 0;
    int count = 0;  // for level 1
    bool isDeferred = false;
    std::string baseAddress;
};

// A number of any size; only its sign and its first nine digits matter.
int clampedNumber(const std::string& name, const std::string& text, int most) {
    long long number = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
    if (end != text.data() + text.size() || error == std::errc::invalid_argument)
        throw std::invalid_argument(name + " is '" + text + "', which is no number");
    if (error == std::errc::result_out_of_range) return text.starts_with('-') ? 0 : most;
    return int(std::clamp<long long>(number, 0, most));
}

Options optionsOf(const EdfArguments& arguments) {
    Options options;
    for (const auto& [name, text] : arguments) {
        if (name == "dataLodLevel") options.level = clampedNumber(name, text, 2);
        if (name == "lod1Count") options.count = clampedNumber(name, text, 1'000'000'000);
        if (name == "baseAddress") options.baseAddress = text;
        if (name != "deferredRead") continue;
        if (text != "true" && text != "false" && text != "1" && text != "0")
            throw std::invalid_argument(name + " is '" + text + "'; it must be true or false");
        options.isDeferred = text == "true" || text == "1";
    }
    return options;
}

// One cache for the process, because all payloads share the folder and its bound. It is never
// destroyed: a read that nobody waits for may use it while the process exits.
museum::AnswerCache* sharedCache() {
    if (pxr::TfGetenv("USDLIVE_EDF_CACHE") == "0") return nullptr;
    static auto& cache = *new museum::AnswerCache;
    return &cache;
}

museum::FetchLimits limitsFor(std::size_t bodyBytes) {
    museum::FetchLimits limits;
    limits.bodyBytes = bodyBytes;
    const double seconds = pxr::TfGetenvDouble("USDLIVE_EDF_REQUEST_SECONDS", 15);
    limits.request =
        std::chrono::milliseconds(std::int64_t(std::clamp(seconds, 0.01, 600.0) * 1000));
    return limits;
}

class MuseumProvider final : public usdlive::edf::IEdfDataProvider {
public:
    explicit MuseumProvider(const EdfDataParameters& parameters)
        : options_(optionsOf(parameters.providerArgs)) {}

    // Only what changes the content identifies it: a count matters at level 1, deferring from level
    // 1 on.
    static EdfArguments ComposeArguments(const EdfArguments& metadata) {
        const Options options = optionsOf(metadata);
        EdfArguments composed{{"dataLodLevel", std::to_string(options.level)}};
        if (options.level == 1) composed["lod1Count"] = std::to_string(options.count);
        if (options.level > 0) composed["deferredRead"] = options.isDeferred ? "true" : "false";
        if (!options.baseAddress.empty()) composed["baseAddress"] = options.baseAddress;
        return composed;
    }

    bool Read(IEdfSourceData& data, std::string& why) override {
        data.SetMayChange();
        auto address =
            museum::chooseAddress(options_.baseAddress, pxr::TfGetenv("USDLIVE_EDF_MUSEUM_URL"),
                                  pxr::TfGetenv("USDLIVE_EDF_ALLOWED_HOSTS"));
        if (!address) return fail(why, address.error());
        address_ = std::move(*address);
        const auto answer = get(data, {"/departments"}, kDefaultBodyBytes).front();
        if (!answer) return fail(why, answer.error().cause);
        const auto departments = museum::readDepartments(*answer);
        if (!departments)
            return fail(why, address_.text() + "/departments: " + departments.error());
        for (const auto& department : *departments) create(data, department);
        if (options_.level == 0) return true;
        if (!options_.isDeferred) return createObjects(data, departments_, why);
        for (const auto& [path, id] : departments_) data.DeferChildren(path);
        return true;
    }

    bool ReadChildren(const SdfPath& prim, IEdfSourceData& data, std::string& why) override {
        const auto department = departments_.find(prim);
        if (department == departments_.end())
            return fail(why, "no department is at " + prim.GetAsString());
        return createObjects(data, {*department}, why);
    }

private:
    using Departments = std::map<SdfPath, std::string>;
    static constexpr std::size_t kDefaultBodyBytes = museum::FetchLimits().bodyBytes;

    static bool fail(std::string& why, std::string reason) {
        why = std::move(reason);
        return false;
    }

    std::vector<museum::Body> get(IEdfSourceData& data, const std::vector<std::string>& targets,
                                  std::size_t bodyBytes) const {
        auto [answers, stale] =
            museum::Fetcher(address_, limitsFor(bodyBytes), sharedCache()).get(targets, [&data] {
                return data.IsCancelled();
            });
        if (stale > 0)
            data.Warn(std::to_string(stale) + " answers are from the cache, because " +
                      address_.text() + " cannot be reached");
        return std::move(answers);
    }

    void create(IEdfSourceData& data, const museum::Department& department) {
        std::string name = pxr::TfMakeValidIdentifier(department.displayName);
        if (names_.contains(name)) name += "_" + department.id;
        while (!names_.insert(name).second) name += "_";
        data.CreatePrim(root_, name, pxr::SdfSpecifierDef, TfToken("AmaDepartment"));
        const SdfPath path = root_.AppendChild(TfToken(name));
        addText(data, path, "departmentId", department.id);
        addText(data, path, "displayName", department.displayName);
        departments_.emplace(path, department.id);
    }

    // The lists of all departments first, then all objects, each at the same time.
    bool createObjects(IEdfSourceData& data, const Departments& departments,
                       std::string& why) const {
        std::vector<std::string> lists;
        for (const auto& [path, id] : departments) lists.push_back("/objects?departmentIds=" + id);
        const auto answers = get(data, lists, kDefaultBodyBytes);
        std::vector<std::string> objects;
        std::vector<SdfPath> parents;
        Problems problems("department");
        std::size_t index = 0;
        for (const auto& [path, id] : departments) {
            const auto& answer = answers[index++];
            const auto ids =
                answer ? museum::readObjectIds(*answer) : tl::unexpected(answer.error().cause);
            if (!ids) {
                problems.add(answer ? lists[index - 1] + ": " + ids.error() : ids.error());
                continue;
            }
            const auto count = options_.level == 1 && options_.count > 0
                                   ? std::min<std::size_t>(options_.count, ids->size())
                                   : ids->size();
            for (std::size_t i = 0; i < count && objects.size() <= kMaxObjects; ++i) {
                objects.push_back("/objects/" + (*ids)[i]);
                parents.push_back(path);
            }
        }
        // If not even one list could be read, the service is down, and nothing is not the answer.
        if (!departments.empty() && problems.count() == departments.size())
            return fail(why, problems.text());
        if (objects.size() > kMaxObjects) {
            data.Warn("there are more than " + std::to_string(kMaxObjects) +
                      " objects; the others are left out");
            objects.pop_back();
        }
        problems.warn(data);
        createEach(data, objects, parents);
        return true;
    }

    void createEach(IEdfSourceData& data, std::vector<std::string> objects,
                    const std::vector<SdfPath>& parents) const {
        // An object can belong to several departments, and is requested once.
        std::map<std::string, std::size_t> places;
        std::vector<std::string> targets;
        for (const auto& object : objects)
            if (places.emplace(object, targets.size()).second) targets.push_back(object);
        const auto answers = get(data, targets, kMaxObjectBytes);
        Problems problems("object");
        std::set<SdfPath> used;
        for (std::size_t i = 0; i < objects.size(); ++i) {
            const auto& answer = answers[places.at(objects[i])];
            const auto object =
                answer ? museum::readObject(*answer) : tl::unexpected(answer.error().cause);
            if (!object)
                problems.add(answer ? objects[i] + ": " + object.error() : object.error());
            else if ("/objects/" + object->id != objects[i])
                problems.add(objects[i] + ": malformed answer: it is about the object " +
                             object->id);
            else
                create(data, nameIn(parents[i], *object, used), *object);
        }
        problems.warn(data);
    }

    // Names end with the id, but "A1" + "2" is also "A" + "12".
    static SdfPath nameIn(const SdfPath& parent, const museum::MuseumObject& object,
                          std::set<SdfPath>& used) {
        std::string name = pxr::TfMakeValidIdentifier(object.name + object.id);
        while (!used.insert(parent.AppendChild(TfToken(name))).second) name += "_" + object.id;
        return parent.AppendChild(TfToken(name));
    }

    static void create(IEdfSourceData& data, const SdfPath& path,
                       const museum::MuseumObject& object) {
        data.CreatePrim(path.GetParentPath(), path.GetName(), pxr::SdfSpecifierDef,
                        TfToken("AmaObject"));
        if (object.hasArtist)
            data.SetField(path, TfToken("apiSchemas"),
                          VtValue(pxr::SdfTokenListOp::Create({TfToken("ArtistAPI")})));
        addText(data, path, "objectId", object.id);
        for (const auto& [attribute, flag] : object.flags)
            data.CreateAttribute(path, TfToken(attribute), pxr::SdfValueTypeNames->Bool,
                                 pxr::SdfVariabilityUniform, VtValue(flag));
        for (const auto& [attribute, text] : object.texts) addText(data, path, attribute, text);
    }

    static void addText(IEdfSourceData& data, const SdfPath& prim, const char* name,
                        const std::string& text) {
        data.CreateAttribute(prim, TfToken(name), pxr::SdfValueTypeNames->String,
                             pxr::SdfVariabilityUniform, VtValue(text));
    }

    // Parts that could not be read, as one warning.
    class Problems {
    public:
        explicit Problems(const char* what) : what_(what) {}
        void add(const std::string& problem) {
            if (count_++ == 0) first_ = problem;
        }
        [[nodiscard]] std::size_t count() const { return count_; }
        [[nodiscard]] std::string text() const {
            return std::to_string(count_) + " " + what_ + (count_ == 1 ? "" : "s") +
                   " could not be read: " + first_;
        }
        void warn(IEdfSourceData& data) const {
            if (count_ > 0) data.Warn(text());
        }

    private:
        const char* const what_;
        std::size_t count_ = 0;
        std::string first_;
    };

    const Options options_;
    const SdfPath root_{"/Data"};
    museum::Address address_;
    std::set<std::string> names_;
    Departments departments_;  // not changed after Read()
};

}  // namespace

EDF_DEFINE_DATAPROVIDER(MuseumProvider, "OmniMetProvider");
