// modelDescription.xml of the FMU of one scene, generated from its variable table.
//
// It is written when the FMU is built (`dockloop build`), never by hand and never at run time, so
// the file and the binary cannot disagree: both come from make_variables().
#pragma once

#include <string>

#include "sim/docking_sim.hpp"

#ifndef DOCKLOOP_VERSION  // in the sources of an FMU, which other build files compile
#define DOCKLOOP_VERSION "0.1.0"
#endif

namespace dockloop {

/// @param sim  freshly constructed from the scene: its start values are written into the file
/// @param generation_time  xs:dateTime in UTC, e.g. "2025-01-31T12:00:00Z"; an argument, so that
///                         equal scenes can give equal bytes
std::string make_model_description(DockingSim& sim, const std::string& generation_time);

/// `text` as content of an XML attribute: markup and control characters replaced.
std::string xml_escape(const std::string& text);

/// Shortest decimal number that reads back as exactly this value.
std::string shortest(double value);

}  // namespace dockloop
