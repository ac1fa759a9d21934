//! USB device: one CDC-ACM interface.

use crate::board;
use crate::link::{self, PACKET, Port};
use crate::vectors::Irqs;
use crate::watch::{self, Task};
use embassy_executor::Spawner;
use embassy_futures::join::join;
use embassy_stm32::peripherals::{PA11, PA12, USB_OTG_FS};
use embassy_stm32::usb::{Config, Driver};
use embassy_stm32::{Peri, pac, uid};
use embassy_usb::class::cdc_acm::{CdcAcmClass, State};
use embassy_usb::{Builder, Handler, UsbDevice};
use static_cell::{ConstStaticCell, StaticCell};

/// Vendor and product numbers by which the host's program finds the station: pid.codes' test
/// product. Replace them before making more than a few stations.
const VENDOR: u16 = 0x1209;
const PRODUCT: u16 = 0x0001;

type Otg = Driver<'static, USB_OTG_FS>;

/// Drops the data that a departed host did not fetch.
///
/// A packet that waits in an endpoint outlives the reset with which the next host begins: by the
/// manual (RM0090, 34.17) an endpoint's enable bit ends with its transfer or when it is disabled,
/// and the driver does neither. Then no packet can ever be written to that endpoint again.
struct Reconnection;

impl Handler for Reconnection {
    fn reset(&mut self) {
        // Endpoint 0 recovers with its next SETUP packet.
        for endpoint in 1..ENDPOINTS {
            let control = pac::USB_OTG_FS.diepctl(endpoint);
            if control.read().epena() {
                control.modify(|w| {
                    w.set_snak(true);
                    w.set_epdis(true);
                });
            }
        }
    }
}

/// Endpoints of the controller per direction.
const ENDPOINTS: usize = 4;

/// Starts the device and its link. Call once.
pub fn start(
    spawner: Spawner,
    controller: Peri<'static, USB_OTG_FS>,
    dp: Peri<'static, PA12>,
    dm: Peri<'static, PA11>,
) {
    static OUT: ConstStaticCell<[u8; 256]> = ConstStaticCell::new([0; 256]);
    static CONFIG: ConstStaticCell<[u8; 128]> = ConstStaticCell::new([0; 128]);
    static BOS: ConstStaticCell<[u8; 32]> = ConstStaticCell::new([0; 32]);
    static CONTROL: ConstStaticCell<[u8; 64]> = ConstStaticCell::new([0; 64]);
    static STATE: StaticCell<State> = StaticCell::new();
    static RECONNECTION: ConstStaticCell<Reconnection> = ConstStaticCell::new(Reconnection);

    let mut driver_config = Config::default();
    // PA9 need not be wired to the bus voltage.
    driver_config.vbus_detection = false;
    let driver = Driver::new_fs(controller, Irqs, dp, dm, OUT.take(), driver_config);
    let mut config = embassy_usb::Config::new(VENDOR, PRODUCT);
    config.manufacturer = Some("Trinocular");
    config.product = Some(board::NAME);
    config.serial_number = Some(uid::uid_hex());
    let mut builder = Builder::new(
        driver,
        config,
        CONFIG.take(),
        BOS.take(),
        &mut [],
        CONTROL.take(),
    );
    builder.handler(RECONNECTION.take());
    let class = CdcAcmClass::new(&mut builder, STATE.init(State::new()), PACKET as u16);
    spawner.spawn(crate::spawned(device(builder.build())));
    spawner.spawn(crate::spawned(serve(class)));
}

#[embassy_executor::task]
async fn device(mut device: UsbDevice<'static, Otg>) {
    // The device must not be dropped while it works, and has no work while the cable is unplugged.
    join(device.run(), async {
        loop {
            watch::alive(Task::Device);
            watch::look(Task::Device).await;
        }
    })
    .await;
}

#[embassy_executor::task]
async fn serve(class: CdcAcmClass<'static, Otg>) {
    static BUFFER: ConstStaticCell<[u8; PACKET]> = ConstStaticCell::new([0; PACKET]);
    let (tx, rx, control) = class.split_with_control();
    link::serve(Port::Usb, rx.into_buffered(BUFFER.take()), tx, || {
        control.dtr()
    })
    .await
}
