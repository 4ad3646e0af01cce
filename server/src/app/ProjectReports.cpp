// Gathers the reports of several projects.
#include "app/ProjectReports.h"

#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <map>
#include <memory>
#include <utility>

namespace usdlive::server {

namespace asio = boost::asio;

// Projects that have not answered after this time are reported as busy.
constexpr std::chrono::milliseconds kReportTime{1'000};

void gatherReports(asio::io_context& io, const std::vector<ServedProject*>& projects,
                   bool haveMetrics, std::function<void(const ProjectReports&)> done) {
    struct Gathered {
        std::map<std::string, ServedProject::Report> reports;
        std::size_t missing = 0;
        std::function<void(const ProjectReports&)> done;
        asio::steady_timer timer;

        void end() {
            if (!done) return;
            timer.cancel();
            const ProjectReports all(reports.begin(), reports.end());
            std::exchange(done, nullptr)(all);
        }
    };
    auto all = std::make_shared<Gathered>(
        Gathered{{}, projects.size(), std::move(done), asio::steady_timer(io, kReportTime)});
    for (ServedProject* project : projects) {
        all->reports[project->name()].status = "busy";
        project->report(haveMetrics,
                        [&io, all, name = project->name()](ServedProject::Report report) {
                            asio::post(io, [all, name, report = std::move(report)]() mutable {
                                all->reports[name] = std::move(report);
                                if (--all->missing == 0) all->end();
                            });
                        });
    }
    if (projects.empty()) return all->end();
    all->timer.async_wait([all](const boost::system::error_code& error) {
        if (!error) all->end();
    });
}

}  // namespace usdlive::server
