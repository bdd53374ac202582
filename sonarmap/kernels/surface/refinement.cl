// The kernels of a refinement. They are one program, as a compiler takes a tenth of a second to begin each.
#include "surface/pairs.cl"
#include "surface/equations.cl"
#include "surface/solve.cl"
