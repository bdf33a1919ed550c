// Categories of log lines: one table for the logger and for modelDescription.xml.
#pragma once

#include <array>

namespace dockloop {

struct LogCategory {
  const char* name;
  const char* description;
};

/// The first three belong to the fmi2Status of the line; logEvents is for debugging.
enum Category : unsigned { kLogWarning, kLogDiscard, kLogError, kLogEvents, kLogChoices };
constexpr std::array<LogCategory, 5> kLogCategories = {{
    {"logStatusWarning", "Something that should be looked at; the run goes on"},
    {"logStatusDiscard", "A step that failed and may succeed with a smaller step size"},
    {"logStatusError", "A call that was refused or failed"},
    {"logEvents", "Changes of the docking phase, for debugging"},
    {"logChoices", "What the parameter accuracy has chosen, and at the end what was left out"},
}};

}  // namespace dockloop
