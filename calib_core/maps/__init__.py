"""Point clouds as files, and the accumulated room: voxels, normals, a mesh, and how crisp it is. What Open3D is for.

files       .ply and .pcd, every field kept          accumulate  scans laid together, a return in each voxel
room        the map without strays, with normals     surface     strays, normals and the mesh, by Open3D
crispness   how sharp a map is, knowing no planes    carry       the motion carried by the IMU alone, to judge an extrinsic

Open3D takes a second and 120 MB to import and needs system libraries: library.py alone imports it, when it is called.
"""
