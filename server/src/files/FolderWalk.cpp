// Walks through a project's folder and follows links inside it (FI5).
#include "files/FolderWalk.h"

#include <algorithm>
#include <system_error>
#include <vector>

namespace usdlive::server {

namespace fs = std::filesystem;

namespace {

bool startsWithDot(const fs::path& part) { return part.native().starts_with('.'); }

class FolderWalk {
public:
    FolderWalk(const fs::path& root, const FolderVisitor& visitor)
        : root_(root), visitor_(visitor) {}

    Result<void> run() {
        std::error_code problem;
        folder(root_, "", problem);
        if (!problem) return {};
        return fail(ErrorCode::LayerUnreadable,
                    "the folder " + root_.string() + " cannot be listed: " + problem.message());
    }

private:
    void folder(const fs::path& real, const std::string& name, std::error_code& problem) {
        open_.push_back(real);
        if (visitor_.folder) visitor_.folder(real);
        fs::directory_iterator entry(real, problem);
        for (; !problem && entry != fs::directory_iterator(); entry.increment(problem)) {
            const std::string file = entry->path().filename();
            if (file.starts_with('.')) continue;
            visit(*entry, name.empty() ? file : name + "/" + file);
        }
        open_.pop_back();
    }

    void visit(const fs::directory_entry& entry, const std::string& name) {
        std::error_code ignored;
        const auto type = entry.symlink_status(ignored).type();
        if (type == fs::file_type::regular) file(name, entry.path());
        if (type == fs::file_type::directory) below(entry.path(), name);
        if (type == fs::file_type::symlink) link(entry.path(), name);
    }

    void file(const std::string& name, const fs::path& real) {
        if (links_ == 0 || ++overLinks_ <= kMostOverLinks) return visitor_.file(name, real);
        if (overLinks_ == kMostOverLinks + 1)
            visitor_.skipped(name,
                             "more than " + std::to_string(kMostOverLinks) +
                                 " files are found over links; this one and all later ones are "
                                 "served by their own names only");
    }

    void below(const fs::path& real, const std::string& name) {
        if (overLinks_ > kMostOverLinks && links_ > 0) return;
        std::error_code problem;
        folder(real, name, problem);
        if (problem) visitor_.skipped(name, "the folder cannot be listed: " + problem.message());
    }

    void link(const fs::path& path, const std::string& name) {
        std::error_code problem;
        const fs::path real = fs::canonical(path, problem);
        if (problem) return visitor_.skipped(name, "the link leads nowhere: " + problem.message());
        if (const std::string why = whyOutside(root_, real); !why.empty())
            return visitor_.skipped(name, "the link leads " + why);
        if (fs::is_regular_file(real, problem)) return file(name, real);
        if (!fs::is_directory(real, problem)) return;
        if (std::ranges::find(open_, real) != open_.end())
            return visitor_.skipped(name, "the link leads back to a folder above it");
        ++links_;
        below(real, name);
        --links_;
    }

    const fs::path& root_;
    const FolderVisitor& visitor_;
    std::vector<fs::path> open_;  // the real paths of the folders above
    int links_ = 0;               // number of followed links to folders
    std::size_t overLinks_ = 0;
};

}  // namespace

Result<void> walkFolder(const fs::path& folder, const FolderVisitor& visitor) {
    return FolderWalk(folder, visitor).run();
}

std::string whyOutside(const fs::path& folder, const fs::path& real) {
    const fs::path inside = real.lexically_relative(folder);
    if (inside == ".") return {};
    if (inside.empty() || *inside.begin() == "..") return "out of the project";
    if (std::ranges::any_of(inside, startsWithDot)) return "to a hidden file or folder";
    return {};
}

}  // namespace usdlive::server
