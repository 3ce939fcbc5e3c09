// What photons leave on diffuse surfaces.
#ifndef PHOTON_DEPOSIT_H
#define PHOTON_DEPOSIT_H

// Of a photon's deposits so many are kept, each as likely, for all.
#define PHOTON_DEPOSITS 8u
// A deposit: position, normal of the surface on the side it came from, flux, scattering events before it; these with a minus where all
// of them were at mirrors and glass, which makes it part of a caustic.
#define DEPOSIT_WORDS 12u
// Caustics are sharp, and have many photons where they are bright: of theirs only those within so much of the radius count.
#define CAUSTIC_RADIUS 0.5f

#endif
