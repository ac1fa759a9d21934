use host::flow::*; use host::images::*; use host::sums::Sums; use shared::rig::Rig;
use host::images::{Scene,SceneSettings,Texture,TextureKind};
fn main(){
  let rig=Rig::paper();
  let moves=[[10.,10.,0.],[15.,15.,0.],[20.,20.,0.],[0.,0.,3.],[0.,0.,5.],[0.,0.,7.],[15.,15.,2.],[20.,20.,2.]];
  let seeds: u64 = std::env::args().nth(1).and_then(|s| s.parse().ok()).unwrap_or(2);
  for kind in TextureKind::ALL { for seed in 0..seeds {
    let scene=Scene::new(&rig,&Texture::of_kind(kind,seed),SceneSettings::default()).unwrap();
    let a=scene.render([0.;3],0,seed*100);
    let t0=std::time::Instant::now();
    let mut flow=Flow::new(&rig,Settings{radius_px:std::env::var("R").map_or(10,|v|v.parse().unwrap()),corners:std::env::var("C").map_or(300,|v|v.parse().unwrap()),distance_px:std::env::var("D").map_or(9,|v|v.parse().unwrap()),..Default::default()}).unwrap();
    let r=flow.set_reference(&a);
    let tr=t0.elapsed();
    if let Err(e)=r { println!("{kind} {seed} reference: {e}"); continue; }
    for (i,m) in moves.iter().enumerate(){
      let b=scene.render(*m,1,seed*100+1+i as u64);
      let t0=std::time::Instant::now();
      let got = flow.measure(&b);
      let tm=t0.elapsed();
      match got { Ok(g)=>{
        let e=Sums::new(&rig,&g.tracks).unwrap().estimates();
        let mid=e.midpoint.unwrap(); let d=mid.displacement_mm; let s=mid.sigma_mm();
        let err:Vec<f64>=(0..3).map(|k| d[k]-m[k]).collect();
        let bad = err[0].abs()>0.02||err[1].abs()>0.02||err[2].abs()>0.05;
        println!("{kind} {seed} {m:?} err {:+.4} {:+.4} {:+.4} sig {:.4} {:.4} {:.4} px {:.3} n {} {:?} ref {tr:.1?} {tm:.1?} {}",err[0],err[1],err[2],s[0],s[1],s[2],mid.sigma_px,g.tracks.len(),g.rejected, if bad {"BAD"} else {""});
      } Err(e)=>println!("{kind} {seed} {m:?} refused {e}") }
    }
  }}
}
