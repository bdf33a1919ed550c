// Columns of numbers in SIMD lanes; see column_lanes.hpp. Compiled once per instruction set.
#pragma once

#include "math/column_lanes.hpp"
#include "math/lane_arithmetic.hpp"

namespace dockloop::columns {
namespace {

using lanes::Lanes;

void add_up(const double* weight, const double* columns, int count, int length, double h,
            const double* base, double* sum) {
  constexpr int kRegisters = kGroup / LANES;
  for (int i = 0; i < length; i += kGroup) {
    Lanes total[kRegisters] = {}, number;
    const double* column = columns + i;
    for (int j = 0; j < count; ++j, column += length) {
      for (int l = 0; l < kRegisters; ++l) {
        __builtin_memcpy(&number, column + l * LANES, sizeof number);
        total[l] += weight[j] * number;
      }
    }
    for (int l = 0; l < kRegisters; ++l) {
      __builtin_memcpy(&number, base + i + l * LANES, sizeof number);
      number += h * total[l];
      __builtin_memcpy(sum + i + l * LANES, &number, sizeof number);
    }
  }
}

/// A column of N numbers in whole registers.
template <int N>
struct Column {
  static constexpr int kWide = N % 4 == 0 && LANES >= 4 ? 4 : 2, kParts = N / kWide;
  static_assert(N % kWide == 0);
  typedef double Part __attribute__((vector_size(8 * kWide)));
};

/// Columns W = L D^(1/2) of the factor, and the reciprocals of D, one after another: no operation
/// waits for a square root. Whole registers, so that all loops have constant bounds.
template <int N>
struct Elimination : Column<N> {
  using Column<N>::kWide, Column<N>::kParts;
  using Part = typename Column<N>::Part;
  Part W[N][kParts];
  double inverse[N];

  template <int J = 0>
  void eliminate(const double* A) {
    if constexpr (J < N) {
      constexpr int kFirst = J / kWide;
      Part column[kParts];
      __builtin_memcpy(column + kFirst, A + N * J + kWide * kFirst,
                       sizeof(Part) * (kParts - kFirst));
#pragma GCC unroll 12
      for (int k = 0; k < J; ++k) {
        const double factor = W[k][kFirst][J % kWide] * inverse[k];
        for (int i = kFirst; i < kParts; ++i) column[i] -= factor * W[k][i];
      }
      inverse[J] = 1.0 / column[kFirst][J % kWide];
      for (int i = kFirst; i < kParts; ++i) W[J][i] = column[i];
      eliminate<J + 1>(A);
    }
  }

  bool put_factor(double* L) const {
    bool positive = true;
    for (int j = 0; j < N; ++j) {
      const int first = j / kWide;
      const double pivot = W[j][first][j % kWide];
      positive = positive && !(pivot <= 0.0);  // NaN is not detected here, as with Eigen
      const double root = 1.0 / __builtin_sqrt(pivot);
      for (int i = first; i < kParts; ++i) {
        const Part scaled = W[j][i] * root;
        __builtin_memcpy(L + N * j + kWide * i, &scaled, sizeof scaled);
      }
    }
    return positive;
  }
};

template <int N>
bool factorise(const double* A, double* L) {
  Elimination<N> of;
  of.eliminate(A);
  return of.put_factor(L);
}

/// Downwards all rows of a register change together: rows above the present one are finished, and
/// what happens to them is not read. Upwards the products of a column are found together, and taken
/// off in the order of the rows.
template <int N>
void solve(const double* L, double* x) {
  constexpr int kWide = Column<N>::kWide, kParts = Column<N>::kParts;
  using Part = typename Column<N>::Part;
  Part rest[kParts], column;
  double inverse[N], y[N];
  for (int j = 0; j < N; ++j) inverse[j] = 1.0 / L[N * j + j];
  __builtin_memcpy(rest, x, sizeof rest);
#pragma GCC unroll 12
  for (int j = 0; j < N; ++j) {
    y[j] = rest[j / kWide][j % kWide] * inverse[j];
    for (int i = j / kWide; i < kParts; ++i) {
      __builtin_memcpy(&column, L + N * j + kWide * i, sizeof column);
      rest[i] -= y[j] * column;
    }
  }
  __builtin_memcpy(rest, y, sizeof rest);
#pragma GCC unroll 12
  for (int j = N - 1; j >= 0; --j) {
    double sum = y[j];
    for (int i = kParts - 1; i >= j / kWide; --i) {
      __builtin_memcpy(&column, L + N * j + kWide * i, sizeof column);
      column *= rest[i];
      for (int k = kWide - 1; k >= 0; --k) {
        if (kWide * i + k > j) sum -= column[k];
      }
    }
    rest[j / kWide][j % kWide] = sum * inverse[j];
  }
  __builtin_memcpy(x, rest, sizeof rest);
}

constexpr ColumnFunctions kFunctions = {add_up, factorise<6>, factorise<12>, solve<12>};

}  // namespace

}  // namespace dockloop::columns
