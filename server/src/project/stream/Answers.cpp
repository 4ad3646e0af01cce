// Keeps answers in order with the commits after which they are sent.
#include "project/stream/Answers.h"

#include <algorithm>
#include <set>
#include <utility>

#include "project/SharedFrame.h"

namespace usdlive::server {

std::optional<Answer> Answers::next(Revision position) {
    if (waiting_.empty() || waiting_.front().after > position) return std::nullopt;
    Answer answer = std::move(waiting_.front());
    waiting_.pop_front();
    return answer;
}

std::vector<std::uint64_t> Answers::rollBack(SessionId session,
                                             const std::vector<LostSubmission>& lost,
                                             Revision durable, const Error& error) {
    std::deque<Answer> before = std::exchange(waiting_, {});
    const auto keepUntil = [&](Revision revision) {
        for (; !before.empty() && before.front().after < revision; before.pop_front()) {
            Answer& answer = before.front();
            if (answer.repeats && answer.after > durable) continue;  // refused below
            answer.after = std::min(answer.after, durable);
            waiting_.push_back(std::move(answer));
        }
    };
    std::set<Revision> repeated;
    for (const Answer& answer : before)
        if (answer.repeats) repeated.insert(answer.after);
    std::vector<std::uint64_t> refused;
    for (const LostSubmission& one : lost) {
        if (one.session != session && !repeated.contains(one.revision)) continue;
        keepUntil(one.revision);
        waiting_.push_back({durable, sharedFrame(RefusalFrame{one.sequence, 0, error})});
        refused.push_back(one.sequence);
    }
    keepUntil(~Revision(0));
    return refused;
}

}  // namespace usdlive::server
