// Textures in the place of plugins' parameters. In the place of this file the host gives the programs of scenes with plugins a function
//
//     void plugin_textured(const Scene* scene, const Attributes* a, const TextureSlots* slots, vuint plugin, vfloat* numbers)
//
// which puts them there, for it knows which number is which parameter (clrender/plugins/program.py).
#ifndef PLUGIN_TEXTURED_H
#define PLUGIN_TEXTURED_H

#endif
