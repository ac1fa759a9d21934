use host::flow::*; use shared::rig::Rig;
use host::images::{Scene,SceneSettings,Texture,TextureKind};
fn main(){
  let rig=Rig::paper();
  for kind in [TextureKind::Natural,TextureKind::Blobs] { for noise in [0.0,2.0] {
    let scene=Scene::new(&rig,&Texture::of_kind(kind,0),SceneSettings{noise_grey:noise,..Default::default()}).unwrap();
    let a=scene.render([0.;3],0,1000);
    let mut flow=Flow::new(&rig,Settings::default()).unwrap(); flow.set_reference(&a).unwrap();
    print!("{kind} {noise}:");
    for i in 0..=10 { let phi=i as f64*0.1; let b=scene.render([phi*850./538.14,0.,0.],1,1001);
      let g=flow.measure(&b).unwrap();
      let m:f64=g.tracks.iter().map(|t| t.pixels[1][1][0]-t.pixels[1][0][0]).sum::<f64>()/g.tracks.len() as f64;
      let l:f64=g.tracks.iter().map(|t| t.pixels[0][1][0]-t.pixels[0][0][0]).sum::<f64>()/g.tracks.len() as f64;
      print!(" {:+.4}/{:+.4}",m-phi,l-phi*533.16/538.14);
    } println!();
  }}
}
