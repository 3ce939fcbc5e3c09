// What photons leave on diffuse surfaces.
#ifndef PHOTON_DEPOSIT_H
#define PHOTON_DEPOSIT_H

// Of a photon's deposits so many are kept, each as likely, for all.
#define PHOTON_DEPOSITS 8u
// A deposit: position, direction it came from, flux, scattering events before it.
#define DEPOSIT_WORDS 12u

#endif
