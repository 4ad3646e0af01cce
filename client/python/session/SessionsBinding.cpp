// The live sessions of a project. Every call releases the interpreter's lock.
#include "SessionsBinding.h"

#include <nanobind/stl/string.h>

#include <string>
#include <utility>

#include "Errors.h"
#include "EventDictionary.h"
#include "usdlive/client/lines/ProjectSessions.h"

namespace nb = nanobind;

namespace usdlive {

namespace {

/// Calls `work` without the interpreter's lock, and returns its result as a dictionary.
template <class Work>
nb::dict dictionaryOf(Work work) {
    return usdlive::toDictionary(orRaise([&] {
        nb::gil_scoped_release release;
        return work();
    }()));
}

client::Take takeOf(const nb::handle& answer) {
    if (answer.is_none()) return client::Take::Undecided;
    return nb::cast<std::string>(answer) == "main" ? client::Take::Main : client::Take::Session;
}

/// `decide`: takes the dictionary of a conflict, and returns "main", "session" or None. The options
/// are copied without the interpreter's lock, and so have a reference. What `decide` raises passes
/// through the merge, which has changed nothing then.
client::SessionMergeOptions optionsOf(bool isDryRun, bool isKept, const nb::callable& decide) {
    return {isDryRun, isKept, [&decide](const client::SessionConflict& conflict) {
                nb::gil_scoped_acquire acquire;
                return takeOf(decide(usdlive::toDictionary(conflict)));
            }};
}

class PythonSessions {
public:
    PythonSessions(const std::string& address, const std::string& user, const std::string& token)
        : sessions_(orRaise([&] {
              nb::gil_scoped_release release;
              return client::ProjectSessions::at(address, user, token);
          }())) {}

    [[nodiscard]] nb::list list() const {
        const auto all = orRaise([&] {
            nb::gil_scoped_release release;
            return sessions_.list();
        }());
        nb::list found;
        for (const client::SessionInfo& one : all) found.append(usdlive::toDictionary(one));
        return found;
    }
    [[nodiscard]] nb::dict create(const std::string& name, Revision from) const {
        return dictionaryOf([&] { return sessions_.create(name, from); });
    }
    [[nodiscard]] nb::dict createFrom(const std::string& name,
                                      const std::string& checkpoint) const {
        return dictionaryOf([&] { return sessions_.createFrom(name, checkpoint); });
    }
    [[nodiscard]] nb::dict end(const std::string& name) const {
        return dictionaryOf([&] { return sessions_.end(name); });
    }
    [[nodiscard]] nb::dict restore(const std::string& name) const {
        return dictionaryOf([&] { return sessions_.restore(name); });
    }
    [[nodiscard]] nb::dict remove(const std::string& name) const {
        return dictionaryOf([&] { return sessions_.remove(name); });
    }
    [[nodiscard]] nb::dict merge(const std::string& name, bool isDryRun, bool isKept,
                                 const nb::callable& decide) const {
        const auto options = optionsOf(isDryRun, isKept, decide);
        return dictionaryOf([&] { return sessions_.merge(name, options); });
    }
    [[nodiscard]] nb::dict update(const std::string& name, bool isDryRun,
                                  const nb::callable& decide) const {
        const auto options = optionsOf(isDryRun, false, decide);
        return dictionaryOf([&] { return sessions_.update(name, options); });
    }

private:
    client::ProjectSessions sessions_;
};

}  // namespace

void bindSessions(nb::module_& module) {
    nb::class_<PythonSessions>(module, "Sessions")
        .def(nb::init<const std::string&, const std::string&, const std::string&>())
        .def("list", &PythonSessions::list)
        .def("create", &PythonSessions::create)
        .def("create_from", &PythonSessions::createFrom)
        .def("end", &PythonSessions::end)
        .def("restore", &PythonSessions::restore)
        .def("delete", &PythonSessions::remove)
        .def("merge", &PythonSessions::merge)
        .def("update", &PythonSessions::update);
}

}  // namespace usdlive
