// A guard of an instance against a second call, from another thread or from a callback.
#pragma once

#include <thread>

#include "instance.hpp"

namespace dockloop {

/// One call of an instance at a time. A second one changes nothing and logs nothing, as the first
/// one may be in the logger: the first one logs the refusal when it ends.
class OneCall {
 public:
  /// @param name  of the FMI function
  OneCall(Instance& self, const char* name) : self_(self) {
    std::thread::id other;
    is_alone_ = self.caller.compare_exchange_strong(other, std::this_thread::get_id());
    if (!is_alone_) self.refused.store(name);
  }
  ~OneCall() {
    if (!is_alone_) return;
    self_.log_refused();
    self_.caller.store(std::thread::id());
  }
  OneCall(const OneCall&) = delete;
  OneCall& operator=(const OneCall&) = delete;
  bool is_alone() const { return is_alone_; }

 private:
  Instance& self_;
  bool is_alone_;
};

}  // namespace dockloop
