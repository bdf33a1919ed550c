// Coefficients of the explicit methods; see runge_kutta.hpp.
#include "integrate/runge_kutta.hpp"

namespace dockloop {
namespace {

// Left as they are: every number would get a line of its own.
// clang-format off

// Dormand and Prince, order 5(4): J. Comp. Appl. Math. 6 (1980) 19-26. Dense output of Shampine.
constexpr double kDormandPrinceA[] = {
    1.0 / 5,          3.0 / 40,         9.0 / 40,        44.0 / 45,     -56.0 / 15,
    32.0 / 9,         19372.0 / 6561,   -25360.0 / 2187, 64448.0 / 6561, -212.0 / 729,
    9017.0 / 3168,    -355.0 / 33,      46732.0 / 5247,  49.0 / 176,    -5103.0 / 18656};
constexpr double kDormandPrinceB[] = {35.0 / 384,  0, 500.0 / 1113, 125.0 / 192, -2187.0 / 6784,
                                      11.0 / 84};
constexpr double kDormandPrinceE[] = {71.0 / 57600,      0,          -71.0 / 16695, 71.0 / 1920,
                                      -17253.0 / 339200, 22.0 / 525, -1.0 / 40};
constexpr double kDormandPrinceDense[] = {-12715105075.0 / 11282082432,
                                          0,
                                          87487479700.0 / 32700410799,
                                          -10690763975.0 / 1880347072,
                                          701980252875.0 / 199316789632,
                                          -1453857185.0 / 822651844,
                                          69997945.0 / 29380423};

// The classic method of order 4.
constexpr double kClassicA[] = {0.5, 0, 0.5, 0, 0, 1};
constexpr double kClassicB[] = {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6};

// Order 4(3), made for the spectrum of a docking: friction in contact, real down to -19.7/h, next to
// rings and latches that swing, up to (-0.4 +- 3i)/h. The polynomial of stability is that of the
// longest step on such a spectrum; the coefficients have it and the least error of order 5, with
// stages that are stable too (tests/studies/stabilised_pair.py).
constexpr double kStableA[] = {
    0.06287046390074937, 0.0567832915158299, 0.18571666037506082, 0.03008875253609599,
    0.1854449702968127, 0.14889912937320837, -0.006162097562586877, 0.1256039405416364,
    0.2769810172166895, 0.15281794913458158, -0.031135633238394064, -0.06260655254683883,
    0.2929678461470866, 0.3003608020190188, 0.18607115211151498, 0.02750633245464169,
    0.1232771482165624, 0.07834547842259038, 0.16796155634370513, 0.0948605100677842,
    0.13241107782329833, 0.0773314208661822, 0.17044255030600367, 0.007245809909318164,
    0.08437442181570007, 0.09963425342122892, 0.22899941642070692, 0.33197212726086006};
constexpr double kStableB[] = {
    0.04431758039459763, 0.10301078295536541, 0.1892842938429524, 0.023865670068609793,
    0.1701898225972354, 0.04241153536774553, 0.29430072391020495, 0.1326195908632889};
constexpr double kStableE[] = {
    0.00574457910922979, -0.01850218172537197, 0.019136977512068137, 0.00621900017665477,
    -0.021685123838118693, -0.01662352072215231, 0.021685123838118697, 0.0018405485392238687,
    0.0021845971103477044};
constexpr double kStableDense[] = {
    -8.691812524737573, 11.936406762513178, -5.057284299115173, 4.075933969413468,
    -1.878492863269975, 0.044471431592409516, -1.1207995036217666, -0.27879895523368914,
    0.9703759824591205};

// clang-format on

}  // namespace

RungeKuttaTable get_dormand_prince() {
  return {6, 4, kDormandPrinceA, kDormandPrinceB, kDormandPrinceE, kDormandPrinceDense};
}
RungeKuttaTable get_stabilised() { return {8, 3, kStableA, kStableB, kStableE, kStableDense}; }
RungeKuttaTable get_classic() { return {4, 0, kClassicA, kClassicB, nullptr, nullptr}; }

}  // namespace dockloop
