// Log lines to the host, for all kinds of FMI loggers.
//
// The callback is similar to printf. It may be null, its language may not support varargs, and it
// may refuse an undeclared category. Therefore the text is complete, every % is doubled, and there
// are no further arguments. The category is one of the table below, which modelDescription.xml
// declares.
#pragma once

#include <fmi2Functions.h>

#include <string>
#include <string_view>

#include "interface/log_categories.hpp"

namespace dockloop {

class Logger {
 public:
  Logger() = default;
  /// `debug` false: all categories except logEvents.
  Logger(const fmi2CallbackFunctions& callbacks, const char* instance_name, bool debug)
      : callback_(callbacks.logger),
        environment_(callbacks.componentEnvironment),
        instance_name_(instance_name ? instance_name : ""),
        enabled_(debug ? kAll : kAll & ~bit(kLogEvents)) {}

  bool enabled(Category category) const { return callback_ && (enabled_ & bit(category)); }

  /// fmi2SetDebugLogging: exactly the named categories (no name: all), or no log.
  /// @return the first unknown name (then nothing is changed); null if all names are known.
  const char* select(bool on, size_t n, const fmi2String names[]) {
    unsigned wanted = 0;
    for (size_t i = 0; i < n; ++i) {
      unsigned category = 0;
      while (category < kLogCategories.size() &&
             (!names[i] || kLogCategories[category].name != std::string(names[i]))) {
        ++category;
      }
      if (category == kLogCategories.size()) return names[i] ? names[i] : "(null)";
      wanted |= bit(category);
    }
    enabled_ = !on ? 0 : n == 0 ? kAll : wanted;
    return nullptr;
  }

  /// One line. Never throws: a failure of logging must not change the effect of a call.
  void write(fmi2Status status, Category category, std::string_view text) const noexcept {
    if (!enabled(category)) return;
    try {
      std::string safe;
      safe.reserve(text.size());
      for (const char c : text) safe.append(c == '%' ? 2 : 1, c);
      callback_(environment_, instance_name_.c_str(), status, kLogCategories[category].name,
                safe.c_str());
    } catch (...) {
    }
  }
  void error(std::string_view text) const noexcept { write(fmi2Error, kLogError, text); }

 private:
  static constexpr unsigned bit(unsigned category) { return 1u << category; }
  static constexpr unsigned kAll = (1u << kLogCategories.size()) - 1;

  fmi2CallbackLogger callback_ = nullptr;
  fmi2ComponentEnvironment environment_ = nullptr;
  std::string instance_name_;
  unsigned enabled_ = 0;
};

}  // namespace dockloop
