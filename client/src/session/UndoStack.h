// Own work that can be undone and redone.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "session/Pending.h"
#include "usdlive/client/session/Undo.h"
#include "usdlive/common/layer/Inverse.h"
#include "usdlive/common/layer/TransactionExecutor.h"

namespace usdlive::client {

/// The steps of own work, with the inverse of each edit, and what others have written since into
/// the specs that they name.
///
/// A step is what one undo takes back: the edits of one Session::author(), of a gesture, or of a
/// group. Its edits have the inverse that the view gives until they are committed, and then that of
/// the commit. An undo makes a transaction of the inverse against the present; the inverse of that
/// transaction is the redo.
///
/// The paths of specs are those that the editor shows. The session reports each change of the view
/// to this class: own edits to add(), all others to shown().
class UndoStack {
public:
    /// Bounds of all steps together. The oldest are forgotten first.
    static constexpr std::size_t kMostSteps = 200;
    static constexpr std::size_t kMostBytes = 64 * 1024 * 1024;
    /// Commits of others with more edits than this, that the view does not show yet, clear the
    /// stack.
    static constexpr std::size_t kMostUnread = 100'000;

    struct Bounds {
        std::size_t bytes, unread;
    };
    explicit UndoStack(Bounds bounds = {kMostBytes, kMostUnread});
    ~UndoStack();

    // --- steps
    /// Edits that are added until end() belong to one step. Calls nest: the outermost two count,
    /// and the first label that is not empty.
    void begin(const std::string& label);
    void end();
    [[nodiscard]] bool isOpen() const { return depth_ > 0; }
    [[nodiscard]] UndoLabels labels() const;
    /// Returns the label of the open group; empty if none is open, or it has none.
    [[nodiscard]] std::string label() const;

    // --- own edits
    /// Returns whether an edit that transaction `sequence` is going to make goes with a spec that
    /// the transaction has created just now, so that it needs no inverse of its own. It may return
    /// false for others of that kind. Looks at no other spec: a paste has many of them.
    [[nodiscard]] bool goesWithCreated(std::uint64_t sequence, const AuthoredEdit& edit) const;
    /// Adds an own edit that the view has since now: edit `index` of transaction `sequence`. An
    /// edit with the same numbers is one that it replaces. Precondition: isOpen(), or within
    /// takeBack(). `inverse`: from inverseBefore(). `doc`: the layer after the edit. `seen`: the
    /// revision of the confirmed layers.
    void add(std::uint64_t sequence, std::uint32_t index, const AuthoredEdit& edit, Inverse inverse,
             const LayerDoc& doc, Revision seen);
    /// Edit `index` was removed from an open gesture; the numbers of later ones fall by one.
    void removed(std::uint64_t sequence, std::uint32_t index);
    /// The transaction is not in the project.
    void lost(std::uint64_t sequence);
    /// Returns whether a step has edits of this transaction, which is not committed.
    [[nodiscard]] bool tracks(std::uint64_t sequence) const { return pending_.contains(sequence); }

    // --- what commits say
    /// An executed edit of an own commit: its inverse in the confirmed layers, and its number.
    struct Executed {
        std::uint32_t index = 0;
        const Edit* edit = nullptr;
        Inverse inverse;
        std::uint64_t mark = 0;  ///< the mark of the session's NamespaceLog after the edit
    };
    void committed(std::uint64_t sequence, Revision revision, std::vector<Executed> executed);
    /// Notes a commit of another client. `log` has its moves.
    void othersCommitted(const NamespaceLog& log, const Commit& commit);
    /// Follows what was noted, when the view shows it. `pathInView` returns the path that the view
    /// has for the path that a spec had before entry `mark` of the log.
    using PathInView = std::function<std::optional<std::string>(
        const LayerId& layer, const std::string& path, std::uint64_t mark)>;
    void follow(const PathInView& pathInView);
    /// The oldest revision whose moves follow() needs, or `otherwise`.
    [[nodiscard]] Revision oldestNeeded(Revision otherwise) const;

    // --- the view
    /// The editor gets this edit. It is not an own edit that the editor makes now.
    void shown(const LayerId& layer, const std::string& path, const EditAction& action);
    /// Forgets all edits of a layer.
    void forget(const LayerId& layer);
    void clear();

    // --- undo
    enum class Direction { Undo, Redo };
    [[nodiscard]] bool hasStep(Direction direction) const {
        return !(direction == Direction::Undo ? undo_ : redo_).empty();
    }
    using View = std::function<const LayerDoc*(const LayerId&)>;
    /// Makes an own edit that the editor also gets. add() is called within.
    using Author = std::function<Result<void>(AuthoredEdit)>;
    /// Takes the newest step back, and adds its inverse to the steps of the other direction.
    [[nodiscard]] UndoResult takeBack(Direction direction, const View& view, const Author& author);

    /// Calls `visit` for the big values of steps that are not committed.
    void forEachPendingBlob(const std::function<void(const Value&)>& visit) const;

private:
    struct Site;
    struct Entry;
    struct Part;
    struct Step;
    struct Unread;
    using SitePtr = std::shared_ptr<Site>;
    using PartPtr = std::shared_ptr<Part>;
    using StepPtr = std::shared_ptr<Step>;
    using Sites = std::multimap<std::string, Site*, std::less<>>;

    [[nodiscard]] SitePtr site(const LayerId& layer, const std::string& path);
    template <class Visit>
    void forEachAt(const LayerId& layer, const std::string& path, const Visit& visit) const;
    void unlist(const Site& site);
    void moveSites(const LayerId& layer, std::string from, const std::string& to);
    void moveAside(const LayerId& layer, const std::string& path, const UserName& by);

    Part& partOf(std::uint64_t sequence, Revision seen);
    void insert(Part& part, Entry entry);
    [[nodiscard]] std::optional<Entry> entryOf(Part& part, const LayerId& layer,
                                               const std::string& path, const EditAction& action,
                                               Inverse inverse);
    [[nodiscard]] bool isInOwnCreation(std::uint64_t sequence, const LayerId& layer,
                                       std::string path) const;
    void replaceEntries(const PartPtr& part, Revision revision, std::vector<Executed>& executed);
    static void refine(Part& part, const std::vector<Executed>& executed);
    void readOwn(Unread& one, const std::string& path);
    void readOthers(const Unread& one, const std::string& path);
    void noteBelowCreated(const LayerId& layer, const std::string& path, const std::string& first,
                          const UserName& author, Revision revision,
                          std::optional<Direction> keptBy, const std::string& except = {});
    void sweep();
    void bound();

    class TakingBack;

    /// A spec that a transaction has created, as long as nothing has moved or gone since.
    struct Created {
        std::uint64_t sequence = 0;
        LayerId layer;
        std::string path;
    };

    const Bounds bounds_;
    std::unordered_map<LayerId, Sites> sites_;  // before the steps, which own the sites
    std::deque<StepPtr> undo_, redo_;
    StepPtr current_;  // the step that receives edits; null: none
    int depth_ = 0;
    std::optional<Created> created_;  // the last one
    bool takesBack_ = false, overflows_ = false;
    std::map<std::uint64_t, std::vector<std::weak_ptr<Part>>> pending_;  // by sequence
    std::deque<Unread> unread_;
    std::uint64_t deletions_ = 0;
    UserName deleter_;  // the author of the commit that the view gets
};

}  // namespace usdlive::client
