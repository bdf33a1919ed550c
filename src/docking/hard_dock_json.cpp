// See hard_dock_json.hpp.
#include "docking/hard_dock_json.hpp"

#include <string>

namespace dockloop {
namespace {

constexpr int kMaxFacePoints = 360, kMaxPushers = 24;

double read_azimuth(const JsonReader& item) {
  return item.has("azimuth") || item.has("azimuth_deg") ? item.angle("azimuth") : 0.0;
}

FaceLaw read_faces(const JsonReader& item) {
  FaceLaw law;
  law.points = make_circle(item.whole("count", 24, 1, kMaxFacePoints), item.positive("radius"),
                           read_azimuth(item));
  read_numbers(item, kFaceNumbers, law);
  return law;
}

HookLaw read_hooks(const JsonReader& item) {
  HookLaw law;
  read_numbers(item, kHookNumbers, law);
  const double radius = item.positive("radius");
  const std::vector<JsonReader> rows = item.list("rows", kMaxItems);
  if (rows.empty()) item.fail("needs at least one entry in 'rows'");
  for (const JsonReader& entry : rows) {
    HookRow row;
    row.points = make_circle(entry.at("count").whole(1, kMaxHooks), radius, read_azimuth(entry));
    read_numbers(entry, kHookRowNumbers, row);
    law.rows.push_back(row);
  }
  return law;
}

PusherLaw read_pushers(const JsonReader& item) {
  PusherLaw law;
  law.points = make_circle(item.at("count").whole(1, kMaxPushers), item.non_negative("radius", 0.0),
                           read_azimuth(item));
  read_numbers(item, kPusherNumbers, law);
  law.on_at_start = item.flag("on_at_start", law.on_at_start);
  return law;
}

}  // namespace

HardDock read_hard_dock(const JsonReader& item) {
  HardDock dock;
  if (item.has("faces")) dock.faces = read_faces(item.at("faces"));
  if (item.has("hooks")) dock.hooks = read_hooks(item.at("hooks"));
  if (item.has("pushers")) dock.pushers = read_pushers(item.at("pushers"));
  if (dock.empty()) item.fail("is empty: state faces, hooks or pushers");
  check_hard_dock(dock);
  return dock;
}

}  // namespace dockloop
