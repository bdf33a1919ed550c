// One cut: its residual, the columns of its joints, its bias. Used by the other files of this
// folder and for the gaps at home; users of loops call loops.hpp.
#pragma once

#include "loops/loops.hpp"

namespace dockloop {

/// Positions of one cut and all its residuals.                                   [Y2 (1), (1u)]
template <class S>
void calc_cut_position(const MechanismModel& model, const LoopPlan& plan, int loop,
                       const TreeData<S>& tree, CutData<S>& cut);

/// Add the columns of one loop to G: residual rate = G v.                               [Y2 (2)]
/// @param rows       row of each equation in G, -1 to leave it out
/// @param column_of  column of each velocity in G, -1 to leave it out
template <class S>
void calc_cut_columns(const MechanismModel& model, const LoopPlan& plan, int loop,
                      const std::array<int, kMaxEquations>& rows, const std::vector<int>& column_of,
                      const CutData<S>& cut, MatX<S>& G);

/// gamma of one cut: residual acceleration at zero joint accelerations.          [Y2 (1), (1u)]
/// @param leg  the block of a loop whose terminal path has a closed-form bias, else null
template <class S>
void calc_cut_bias(const MechanismModel& model, const LoopPlan& plan, int loop,
                   const std::array<int, kMaxEquations>& rows, const TreeData<S>& tree,
                   const CutData<S>& cut, const BlockData<S>* leg, VecX<S>& gamma);

/// Does the closed form give the bias of this loop's terminal path?
inline bool has_leg_bias(const ClosedForm* form) {
  return form && form->has_inverse() && form->parent_on_terminal < 0;
}

/// x := C_dep^-1 x for one column of a block.
template <class S, class Column>
void solve_block(const LoopBlock& block, BlockData<S>& data, Column&& x) {
  if (!block.form() || !block.form()->has_inverse()) {
    data.lu.solve(x);
    return;
  }
  data.column = x;
  x.noalias() = data.inverse.lazyProduct(data.column);
}

/// H = -C_dep^-1 G_low of one block.                                              [Y2 (7)]
template <class S>
void calc_block_map(const LoopBlock& block, BlockData<S>& data) {
  for (int j = 0; j < data.H.cols(); ++j) {
    data.H.col(j) = -data.G.col(block.size() + j);
    solve_block<S>(block, data, data.H.col(j));
  }
}

}  // namespace dockloop
