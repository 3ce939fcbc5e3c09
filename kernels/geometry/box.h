// Where a ray is inside an axis-aligned box.
//
// Two properties carry the renderer's promise that a hit does not depend on how the tree is walked. Rounding is monotonic, so a
// box inside another has an interval inside the other's, exactly. And a primitive counts as hit only where the ray passes the box
// of its leaf, at a distance no less than where it enters that box. So no order of visits can lose a hit, and cutting off subtrees
// that begin beyond the nearest hit so far never changes which one is nearest.
#ifndef GEOMETRY_BOX_H
#define GEOMETRY_BOX_H

#include "core/exact.h"

// The far side is pushed out by more than the error of both sides, so that a ray through an edge passes (Ize 2013).
#define BOX_SLACK 1.0000010f

// Where rays begin: just above zero, so that a ray leaving a face of a flat box does not enter it.
#define BOX_START 1.0e-37f

#endif
