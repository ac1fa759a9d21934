use host::flow::*; use host::sums::Sums; use shared::rig::Rig;
use host::images::{Scene,SceneSettings,Texture,TextureKind};
fn main(){
  let rig=Rig::paper();
  let moves=[[0.,0.,3.],[0.,0.,7.],[15.,15.,2.],[4.,4.,1.]];
  for kind in [TextureKind::Natural,TextureKind::Blobs] { for noise in [0.0,2.0] {
    let scene=Scene::new(&rig,&Texture::of_kind(kind,0),SceneSettings{noise_grey:noise,..Default::default()}).unwrap();
    for m in moves { let mut line=String::new(); let mut st=[[0.0f64;2];3]; let n=if noise==0.0 {1} else {8}; let mut sg=[0.0;3];
      for s in 0..n { let a=scene.render([0.;3],0,1000+s*2); let b=scene.render(m,1,1001+s*2);
        let mut flow=Flow::new(&rig,Settings::default()).unwrap(); flow.set_reference(&a).unwrap();
        let g=flow.measure(&b).unwrap(); let e=Sums::new(&rig,&g.tracks).unwrap().estimates().midpoint.unwrap();
        let d=e.displacement_mm; sg=e.sigma_mm();
        for k in 0..3 { let x=d[k]-m[k]; st[k][0]+=x; st[k][1]+=x*x; }
        if s==0 { line=format!("{:?}",g.tracks.len()); }
      }
      let f=n as f64; println!("{kind} noise {noise} {m:?} mean {:+.4} {:+.4} {:+.4} rms {:.4} {:.4} {:.4} sig {:.4} {:.4} {:.4} n {line}",st[0][0]/f,st[1][0]/f,st[2][0]/f,(st[0][1]/f).sqrt(),(st[1][1]/f).sqrt(),(st[2][1]/f).sqrt(),sg[0],sg[1],sg[2]);
    }
  }}
}
