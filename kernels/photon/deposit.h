// What photons leave on diffuse surfaces, and where they scatter in media.
#ifndef PHOTON_DEPOSIT_H
#define PHOTON_DEPOSIT_H

// Of a photon's deposits so many are kept, each as likely, for all.
#define PHOTON_DEPOSITS 8u
// A deposit: DEPOSIT_ROW_* of types.h.
#define DEPOSIT_WORDS 12u
// Caustics are sharp, and have many photons where they are bright: of theirs only those within so much of the radius count.
#define CAUSTIC_RADIUS 0.5f
// In media, so that the ball is as much smaller as the disk: the cube root of the square of that.
#define CAUSTIC_BALL 0.629960525f

#endif
