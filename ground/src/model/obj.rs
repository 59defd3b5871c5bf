//! model.obj with model.mtl and a folder of JPEG textures, for programs that do not read glTF. Same frame as the GLB.

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::Path;

use super::error::{ModelError, at_path};
use super::mesh::Chunk;

/// Folder of the textures, beside the OBJ.
const TEXTURES: &str = "model_textures";

/// Writes `model.obj`, `model.mtl` and `model_textures/`.
pub(super) fn write(out: &Path, chunks: &[Chunk]) -> Result<(), ModelError> {
    let textures = out.join(TEXTURES);
    if textures.exists() {
        fs::remove_dir_all(&textures).map_err(at_path(&textures))?;
    }
    fs::create_dir_all(&textures).map_err(at_path(&textures))?;
    for chunk in chunks {
        let path = textures.join(format!("{}.jpg", chunk.name));
        fs::write(&path, &chunk.jpeg).map_err(at_path(&path))?;
    }
    let path = out.join("model.mtl");
    write_materials(&path, chunks).map_err(at_path(&path))?;
    let path = out.join("model.obj");
    write_meshes(&path, chunks).map_err(at_path(&path))
}

fn write_materials(path: &Path, chunks: &[Chunk]) -> std::io::Result<()> {
    let mut file = BufWriter::new(File::create(path)?);
    for Chunk { name, .. } in chunks {
        // illum 0: the colour as it is, without light.
        writeln!(file, "newmtl {name}\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nillum 0\nmap_Kd {TEXTURES}/{name}.jpg\n")?;
    }
    file.flush()
}

fn write_meshes(path: &Path, chunks: &[Chunk]) -> std::io::Result<()> {
    let mut file = BufWriter::new(File::create(path)?);
    writeln!(file, "# Metres; x right, y up, -z forward along the tunnel (tunnel frame: y, -z, -x).")?;
    writeln!(file, "mtllib model.mtl")?;
    let mut first = 1;
    for chunk in chunks {
        writeln!(file, "o {0}\nusemtl {0}", chunk.name)?;
        for vertex in &chunk.vertices {
            let [x, y, z] =
                std::array::from_fn(|axis| f64::from(vertex.position[axis]) + f64::from(chunk.origin[axis]));
            writeln!(file, "v {x:.5} {y:.5} {z:.5}")?;
        }
        for vertex in &chunk.vertices {
            // OBJ counts v from the lower edge of the picture.
            writeln!(file, "vt {:.6} {:.6}", vertex.uv[0], 1.0 - vertex.uv[1])?;
        }
        for vertex in &chunk.vertices {
            let [x, y, z] = vertex.normal;
            writeln!(file, "vn {x:.5} {y:.5} {z:.5}")?;
        }
        for triangle in chunk.indices.chunks_exact(3) {
            write!(file, "f")?;
            for &index in triangle {
                let number = index + first;
                write!(file, " {number}/{number}/{number}")?;
            }
            writeln!(file)?;
        }
        first += chunk.vertices.len() as u32;
    }
    file.flush()
}

#[cfg(test)]
mod tests {
    use super::super::mesh::Vertex;
    use super::*;

    #[test]
    fn numbers_go_on_from_chunk_to_chunk_and_textures_lie_beside() {
        let vertex = Vertex { position: [1.0, 2.0, -0.5], normal: [0.0, 1.0, 0.0], uv: [0.25, 0.25] };
        let chunk = |name: &str| Chunk {
            name: name.to_owned(),
            origin: [0.0, 0.0, -3.0],
            vertices: vec![vertex; 3],
            indices: vec![0, 1, 2],
            jpeg: vec![1],
        };
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), &[chunk("a"), chunk("b")]).unwrap();
        let text = fs::read_to_string(folder.path().join("model.obj")).unwrap();
        assert!(text.contains("v 1.00000 2.00000 -3.50000") && text.contains("vt 0.250000 0.750000"), "{text}");
        assert!(text.contains("f 1/1/1 2/2/2 3/3/3") && text.contains("f 4/4/4 5/5/5 6/6/6"), "{text}");
        let materials = fs::read_to_string(folder.path().join("model.mtl")).unwrap();
        assert!(materials.contains("map_Kd model_textures/b.jpg"));
        assert!(folder.path().join("model_textures/b.jpg").is_file());
    }
}
