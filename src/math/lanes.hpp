// How many numbers stand side by side in the groups that math/lanes.inl computes with.
#pragma once

namespace dockloop {

constexpr int kGroup = 8;  ///< lanes of a group, whatever the width of a register

}  // namespace dockloop
