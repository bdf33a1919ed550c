// A guard of an instance against a second call, from another thread or from a callback.
#pragma once

#include <thread>

#include "instance.hpp"

namespace dockloop {

/// One call of an instance at a time. A second one changes nothing.
class OneCall {
 public:
  explicit OneCall(Instance& self) : self_(self) {
    is_alone_ = self.caller.compare_exchange_strong(other_, std::this_thread::get_id());
  }
  ~OneCall() {
    if (is_alone_) self_.caller.store(std::thread::id());
  }
  OneCall(const OneCall&) = delete;
  OneCall& operator=(const OneCall&) = delete;
  bool is_alone() const { return is_alone_; }
  /// The call comes from a callback of the first one: its logger must not be called again.
  bool is_nested() const { return other_ == std::this_thread::get_id(); }

 private:
  Instance& self_;
  std::thread::id other_;
  bool is_alone_;
};

}  // namespace dockloop
